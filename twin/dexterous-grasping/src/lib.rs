//! Grasps of robot hands: their representation, their search, and their analysis.
//!
//! - [`force_closure`]: the disturbance that a set of frictional contacts resists, by friction-cone programs, for hard and
//!   soft fingertips. It needs contact points and normals only.
//! - [`synthesis`]: grasps of any object, given by its signed distance, with any hand, given by its kinematics and
//!   surface: a Metropolis-adjusted Langevin chain samples a grasp energy.
//! - [`synthesis::grasp_file`] and [`synthesis::collection`]: files of synthesized grasps.
//! - [`Grasp`] and [`Repertoire`]: grasps of an object on a table, with approach and tensions, ranked by success, and
//!   their files.
//!   [`sampler`] and [`mod@digit_sets`] propose them for hands with named digits and for parallel grippers.
//! - [`taxonomy`]: 19 grasp types, with rules that assign a type to a held grasp.
//!
//! # Example
//! ```
//! use dexterous_grasping::force_closure::wrench_margin;
//! use dexterous_grasping::synthesis::chain::{self, AnnealingSchedule};
//! use dexterous_grasping::synthesis::energy::EnergyWeights;
//! use dexterous_grasping::synthesis::field::DistanceField;
//! use dexterous_grasping::synthesis::sampled_hand::SampledHand;
//! use hand_model::Hand;
//! use nalgebra::{Point3, Vector3};
//!
//! // A ball of 30 mm radius, by its signed distance and outward normal.
//! let corner = Point3::new(0.03, 0.03, 0.03);
//! let ball = DistanceField::sample(&-corner, &corner, &Point3::origin(), 0.003, 0.02, |p| {
//!     (p.coords.norm() - 0.03, p.coords.try_normalize(1e-9).unwrap_or_else(Vector3::x))
//! })?;
//! let hand = SampledHand::from_hand(&Hand::ftac(), 400);
//! let energy = hand.energy(&ball, EnergyWeights::default(), None);
//! let schedule = AnnealingSchedule { burn_in: 400, steady: 50, ..AnnealingSchedule::default() };
//! let grasp = chain::run(&energy, &mut hand.frames(), 4, &schedule, &mut chain::chain_rng(1, 0)).best;
//!
//! let contacts = hand.friction_contacts(&grasp, &ball, 0.8).ok_or("no normal")?;
//! println!("resists {:.2} N", wrench_margin(&contacts, &ball.center, ball.length, 10.0)?);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Units and frames
//! SI: m, rad, N, kg. A pose `a_from_b` maps coordinates in b to a. In the palm frame of a hand with named digits x points
//! towards the thumb, y towards the fingertips and -z out of the palm; objects come along -z. The normal of a contact
//! points into the object.
//!
//! # Features
//! - `schemars`, off by default: `schemars::JsonSchema` for the records that are written to files.
//!
//! # Limitations
//! A chain ends in a posture without physics: penetration and balance are terms of its energy, and only closing the hand
//! in a physics engine, which is not part of this crate, shows that the grasp holds. [`synthesis::collection`],
//! [`synthesis::diversity`] and the thresholds of the built-in rules of [`taxonomy`] are those of the F-TAC Hand.

#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(missing_docs, unreachable_pub)]

pub mod digit_sets;
pub mod force_closure;
pub mod grasp;
pub mod repertoire;
pub mod sampler;
pub mod synthesis;
pub mod taxonomy;

pub use digit_sets::digit_sets;
pub use grasp::Grasp;
pub use repertoire::{Repertoire, RepertoireError};

/// Compiles and runs the example of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
