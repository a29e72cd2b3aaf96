//! Speed of the sampler's parts on one core: the closure energy of 64 instances with 64 contacts (value; with gradient),
//! one evaluation of the whole energy, and iterations of chains with 5 contacts and 2,000 surface points (grasp-steps per
//! second are the throughput that criterion prints).

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dexterous_grasping::synthesis::chain::{self, AnnealingSchedule};
use dexterous_grasping::synthesis::closure_energy::{closure, closure_with_gradient};
use dexterous_grasping::synthesis::energy::{EnergyWeights, GraspEnergy};
use dexterous_grasping::synthesis::field::DistanceField;
use dexterous_grasping::synthesis::frames::LinkFrames;
use dexterous_grasping::synthesis::surface::HandSurface;
use hand_model::Hand;
use nalgebra::{Point3, Vector3};

const INSTANCES: usize = 64;
const CONTACTS: usize = 64;

fn closure_energy(criterion: &mut Criterion) {
    let vector = |n: usize| Vector3::new((0.7 * n as f64).sin(), (1.3 * n as f64).cos(), (2.1 * n as f64).sin());
    let points: Vec<Vector3<f64>> = (0..INSTANCES * CONTACTS).map(vector).collect();
    let pushes: Vec<Vector3<f64>> = points.iter().map(|p| -p.normalize()).collect();
    let mut group = criterion.benchmark_group("closure energy, 64 contacts x 64 instances");
    group.bench_function("value", |bencher| {
        bencher.iter(|| {
            let instances = black_box(&points).chunks(CONTACTS).zip(black_box(&pushes).chunks(CONTACTS));
            instances.map(|(x, c)| closure(x, c)).map(|c| c.balance + c.rank).sum::<f64>()
        });
    });
    let (mut by_points, mut by_pushes) = (vec![Vector3::zeros(); CONTACTS], vec![Vector3::zeros(); CONTACTS]);
    group.bench_function("value and gradient", |bencher| {
        bencher.iter(|| {
            for (x, c) in black_box(&points).chunks(CONTACTS).zip(black_box(&pushes).chunks(CONTACTS)) {
                black_box(closure_with_gradient(x, c, (12.0, 0.05), &mut by_points, &mut by_pushes));
            }
        });
    });
    group.finish();
}

fn grasp_steps(criterion: &mut Criterion) {
    let hand = Hand::ftac();
    let surface = HandSurface::new(&hand, 2000);
    let radius = 0.03;
    let corner = Point3::new(radius, radius, radius);
    let field = DistanceField::sample(&-corner, &corner, &Point3::origin(), 0.002, 0.02, |p| {
        (p.coords.norm() - radius, p.coords.try_normalize(1e-12).unwrap_or_else(Vector3::x))
    })
    .expect("a ball can be sampled");
    let energy = GraspEnergy::new(&hand, &surface, &field, EnergyWeights::default(), None);
    let mut frames = LinkFrames::new(&hand.tree);
    let schedule = AnnealingSchedule::default();
    let steps = (schedule.burn_in + schedule.steady) as u64;
    let mut group = criterion.benchmark_group(format!("chain, 5 contacts, {} surface points", surface.len()));
    group.throughput(Throughput::Elements(steps)).sample_size(20);
    let mut number = 0;
    group.bench_function("grasp-steps", |bencher| {
        bencher.iter(|| {
            number += 1;
            chain::run(&energy, &mut frames, 5, &schedule, &mut chain::chain_rng(1, number))
        });
    });
    group.finish();
}

criterion_group!(benches, closure_energy, grasp_steps);
criterion_main!(benches);
