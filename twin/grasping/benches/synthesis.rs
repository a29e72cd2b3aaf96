//! Speed of the sampler's parts on one core, medians over repetitions: the closure energy of 64 instances with 64 contacts
//! (value; with gradient), and iterations of chains with 5 contacts and 2,000 surface points.
//!
//! A plain program: a benchmark library would bring features that rebuild half of the workspace's dependencies.

use std::hint::black_box;
use std::time::Instant;

use grasping::synthesis::chain::{self, Schedule};
use grasping::synthesis::closure_energy::{closure, closure_with_gradient};
use grasping::synthesis::energy::{GraspEnergy, Weights};
use grasping::synthesis::field::DistanceField;
use grasping::synthesis::frames::Frames;
use grasping::synthesis::surface::HandSurface;
use hand_model::Hand;
use nalgebra::{Point3, Vector3};

const INSTANCES: usize = 64;
const CONTACTS: usize = 64;

/// Median time of `work` over `repetitions`, s.
fn median(repetitions: usize, mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..repetitions)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[repetitions / 2]
}

fn closure_energy() {
    let vector = |n: usize| Vector3::new((0.7 * n as f64).sin(), (1.3 * n as f64).cos(), (2.1 * n as f64).sin());
    let points: Vec<Vector3<f64>> = (0..INSTANCES * CONTACTS).map(vector).collect();
    let pushes: Vec<Vector3<f64>> = points.iter().map(|p| -p.normalize()).collect();
    let value = median(2001, || {
        let instances = black_box(&points).chunks(CONTACTS).zip(black_box(&pushes).chunks(CONTACTS));
        black_box(instances.map(|(x, c)| closure(x, c)).map(|c| c.balance + c.rank).sum::<f64>());
    });
    let (mut by_points, mut by_pushes) = (vec![Vector3::zeros(); CONTACTS], vec![Vector3::zeros(); CONTACTS]);
    let gradient = median(2001, || {
        for (x, c) in black_box(&points).chunks(CONTACTS).zip(black_box(&pushes).chunks(CONTACTS)) {
            black_box(closure_with_gradient(x, c, (12.0, 0.05), &mut by_points, &mut by_pushes));
        }
    });
    println!(
        "closure energy, 64 contacts x 64 instances: value {:.4} ms, with gradient {:.4} ms",
        1e3 * value,
        1e3 * gradient
    );
}

fn grasp_steps() {
    let hand = Hand::ftac();
    let surface = HandSurface::new(&hand, 2000);
    let radius = 0.03;
    let corner = Point3::new(radius, radius, radius);
    let field = DistanceField::sample(&-corner, &corner, &Point3::origin(), 0.002, 0.02, |p| {
        (p.coords.norm() - radius, p.coords.try_normalize(1e-12).unwrap_or_else(Vector3::x))
    })
    .expect("a ball can be sampled");
    let energy = GraspEnergy::new(&hand, &surface, &field, Weights::default(), None);
    let mut frames = Frames::new(&hand.tree);
    let schedule = Schedule::default();
    let mut number = 0;
    let time = median(41, || {
        number += 1;
        black_box(chain::run(&energy, &mut frames, 5, &schedule, &mut chain::stream(1, number)));
    });
    let steps = (schedule.burn_in + schedule.steady) as f64;
    println!("chain, 5 contacts, {} surface points: {:.0} grasp-steps/s", surface.len(), steps / time);
}

fn main() {
    closure_energy();
    grasp_steps();
}
