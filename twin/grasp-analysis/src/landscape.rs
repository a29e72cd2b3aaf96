//! Energy landscapes mapped by attraction and diffusion (ADELM: Hill, Nijkamp and Zhu 2019).
//!
//! [`attraction`] tests whether a chain drawn towards a minimum reaches it, and over which energy. [`mapping`] sorts
//! minima into basins by that test and measures the barriers between them. [`metastability`] finds the pull at which
//! minima are no longer reachable, so that it need not be guessed, and [`disconnectivity`] builds the tree.
//!
//! Two landscapes are mapped: [`multi_well`], whose minima and barriers are exact, and [`grasps`], the energy of grasps
//! on several objects. For the latter, [`calibration`] sets the pull, [`exploration`] runs the mapping, and [`basins`]
//! reports the result.

pub mod attraction;
pub mod basins;
pub mod calibration;
pub mod disconnectivity;
pub mod exploration;
pub mod grasps;
pub mod mapping;
pub mod metastability;
pub mod multi_well;

use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// An energy over states with a distance and a Markov chain.
pub trait Landscape: Sync {
    /// A state, complete when serialized.
    type State: Clone + Send + Sync + Serialize + DeserializeOwned;
    /// A chain at a state, with its working data.
    type Walker;

    /// Starts a chain at `state`.
    fn start_chain(&self, state: &Self::State) -> Self::Walker;

    /// Runs one Metropolis-Hastings step at `temperature` on the energy plus `pull` times the distance to `target`.
    /// Returns the energy without the pull, and the distance, after the step.
    fn step(
        &self,
        walker: &mut Self::Walker,
        target: &Self::State,
        pull: f64,
        temperature: f64,
        rng: &mut ChaCha8Rng,
    ) -> (f64, f64);

    fn energy(&self, state: &Self::State) -> f64;

    fn distance(&self, a: &Self::State, b: &Self::State) -> f64;
}
