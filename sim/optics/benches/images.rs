//! Benchmarks of image formation: `cargo bench -p tactile-optics`, with `--features gpu` on a GPU as well. Cases: idle, a ball
//! and a bumpy shape at 2 N; with and without cast shadows; one sensor and all 17; one and two threads. The timed part
//! starts at indentation maps and ends at image bytes; the throughput is in images.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use hand_model::Hand;
use hand_model::pads::PadCamera;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use tactile_optics::shapes::TEST_SHAPES;
use tactile_optics::{IndentationMap, Sensor, press};

/// Force on each pad, N.
const PRESS_FORCE: f64 = 2.0;

/// Creates a sensor for the first camera of each pad.
fn sensors(hand: &Hand) -> Vec<Sensor> {
    let cameras = hand.pads.iter().map(|pad| &hand.cameras[pad.cameras[0]]);
    cameras.zip(0..).map(|(camera, serial)| Sensor::unit(&hand.pads[camera.pad], camera, serial)).collect()
}

type Scenes = Vec<(&'static str, Vec<IndentationMap>)>;

fn scenes(hand: &Hand) -> Scenes {
    let ball = |x: f64, y: f64| {
        let inside = 0.02f64.powi(2) - x * x - y * y;
        (inside > 0.0).then(|| 0.02 - inside.sqrt())
    };
    let bumpy = TEST_SHAPES.iter().find(|(name, _)| *name == "random").map(|(_, shape)| *shape);
    let maps = |shape: &dyn Fn(f64, f64) -> Option<f64>| -> Vec<IndentationMap> {
        let one = |pad: &hand_model::pads::Pad| {
            let camera: &PadCamera = &hand.cameras[pad.cameras[0]];
            let moved = |x: f64, y: f64| shape(x, y - camera.center_y);
            press(pad, &[camera], &hand.gel(), PRESS_FORCE, moved).map(|mut pressed| pressed.maps.remove(0))
        };
        hand.pads.iter().map(one).collect::<Result<_, _>>().unwrap_or_default()
    };
    let idle = vec![IndentationMap::idle(); hand.pads.len()];
    let bumpy = bumpy.map(|shape| maps(&shape)).unwrap_or_default();
    vec![("idle", idle), ("ball", maps(&ball)), ("bumpy", bumpy)]
}

fn on_cpu(criterion: &mut Criterion) {
    let hand = Hand::ftac();
    let sensors = sensors(&hand);
    for (name, maps) in scenes(&hand) {
        assert_eq!(maps.len(), sensors.len(), "{name} presses into every pad");
        for shadows in [true, false] {
            if name == "idle" && !shadows {
                continue;
            }
            let mut group = criterion.benchmark_group(format!("{name}{}", if shadows { "" } else { ", no shadows" }));
            for (count, threads) in [(1, 1), (17, 1), (17, 2)] {
                let image = |n: usize| {
                    let (sensor, mut rng) = (&sensors[n], ChaCha8Rng::seed_from_u64(n as u64));
                    if shadows {
                        return sensor.render(&maps[n], &mut rng);
                    }
                    let gel = sensor.model().elastomer.deform(sensor.camera(), &maps[n]);
                    sensor.render_unshadowed(gel.as_ref(), &mut rng)
                };
                let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else { continue };
                group.throughput(Throughput::Elements(count as u64));
                group.bench_function(format!("{count} sensors, {threads} threads"), |bencher| {
                    bencher.iter(|| {
                        pool.install(|| (0..count).into_par_iter().for_each(|n| drop(black_box(image(black_box(n))))))
                    });
                });
            }
            group.finish();
        }
    }
}

/// Measures one hand, and 256 hands at once, on a GPU; prints a message without one.
#[cfg(feature = "gpu")]
fn on_gpu(criterion: &mut Criterion) {
    use std::sync::Arc;

    use tactile_optics::{GpuRenderer, RenderJob, Renderer};
    let hand = Hand::ftac();
    let gpu = match GpuRenderer::new(Arc::new(sensors(&hand))) {
        Ok(gpu) => gpu,
        Err(error) => {
            eprintln!("no figures for a GPU: {error}");
            return;
        }
    };
    for (name, maps) in scenes(&hand) {
        let mut group = criterion.benchmark_group(format!("{name} on {}", gpu.device()));
        for hands in [1, 256] {
            let jobs: Vec<RenderJob<'_>> = (0..hands)
                .flat_map(|hand| maps.iter().enumerate().map(move |map| (hand, map)))
                .map(|(hand, (sensor, indentation))| RenderJob {
                    sensor,
                    indentation,
                    noise_seed: hand,
                    brightness: 1.0,
                })
                .collect();
            group.sample_size(10).throughput(Throughput::Elements(jobs.len() as u64));
            group.bench_function(format!("17 x {hands}"), |bencher| bencher.iter(|| black_box(gpu.render(&jobs))));
        }
        group.finish();
    }
}

#[cfg(not(feature = "gpu"))]
fn on_gpu(_: &mut Criterion) {
    eprintln!("no figures for a GPU: built without the feature `gpu`");
}

fn short() -> Criterion {
    use std::time::Duration;
    Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2))
}

criterion_group! { name = images; config = short(); targets = on_cpu, on_gpu }
criterion_main!(images);
