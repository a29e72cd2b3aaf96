//! The GPU backend against the CPU backend, on a software Vulkan adapter (lavapipe) if one is installed, else on a GPU.
//! Without either the test says so and passes, unless `FTAC_VULKAN=required` is set.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used)]

use std::io::Write;
use std::sync::Arc;

use hand_model::Hand;
use hand_model::pads::PadCamera;
use tactile_optics::shapes::TEST_SHAPES;
use tactile_optics::{CpuRenderer, GpuRenderer, IndentationMap, OpticsError, RenderJob, Renderer, Sensor, press};

fn sensors(hand: &Hand) -> Arc<Vec<Sensor>> {
    let one = |(n, camera): (usize, &PadCamera)| Sensor::unit(&hand.pads[camera.pad], camera, 7000 + n as u64);
    Arc::new(hand.cameras.iter().enumerate().map(one).collect())
}

/// Opens any adapter. The message about skipping bypasses the test harness' capture.
fn any_adapter(sensors: &Arc<Vec<Sensor>>) -> Option<GpuRenderer> {
    let software = match GpuRenderer::on_software(sensors.clone()) {
        Ok(renderer) => return Some(renderer),
        Err(error) => error,
    };
    match GpuRenderer::new(sensors.clone()) {
        Ok(renderer) => Some(renderer),
        Err(error) => {
            let why = format!("{software}; {error}");
            assert!(std::env::var("FTAC_VULKAN").as_deref() != Ok("required"), "FTAC_VULKAN=required, but {why}");
            let mut terminal = std::io::stderr();
            writeln!(terminal, "SKIPPED: the GPU backend is not tested here: {why}").unwrap();
            None
        }
    }
}

/// Presses every shape of the set on some camera, a ball on each, also at its border, and adds idle pads.
fn maps(hand: &Hand) -> Vec<(usize, IndentationMap)> {
    let on = |n: usize, force: f64, shape: &dyn Fn(f64, f64) -> Option<f64>| {
        let camera = &hand.cameras[n];
        let moved = |x: f64, y: f64| shape(x, y - camera.center_y);
        (n, press(&hand.pads[camera.pad], &[camera], &hand.gel(), force, moved).unwrap().maps.remove(0))
    };
    let ball = |x0: f64, y0: f64| {
        move |x: f64, y: f64| {
            let inside = 0.012f64.powi(2) - (x - x0).powi(2) - (y - y0).powi(2);
            (inside > 0.0).then(|| 0.012 - inside.sqrt())
        }
    };
    let mut all: Vec<_> = TEST_SHAPES
        .iter()
        .enumerate()
        .map(|(k, (_, shape))| on(k % hand.cameras.len(), 0.5 + 0.15 * k as f64, shape))
        .collect();
    all.extend((0..hand.cameras.len()).map(|n| on(n, 2.0, &ball(0.0, 0.0))));
    all.extend([0, 5, 9].map(|n| on(n, 1.0, &ball(0.4 * hand.cameras[n].w, 0.3 * hand.cameras[n].h))));
    all.push((3, IndentationMap::idle()));
    all
}

/// Creates a job; one of the jobs is slightly brighter.
fn job(sensor: usize, indentation: &IndentationMap, noise: u64) -> RenderJob<'_> {
    RenderJob { sensor, indentation, noise_seed: noise, brightness: if noise == 2 { 1.04 } else { 1.0 } }
}

#[test]
fn both_backends_make_the_same_images() {
    let hand = Hand::ftac();
    let sensors = sensors(&hand);
    let Some(gpu) = any_adapter(&sensors) else { return };
    let maps = maps(&hand);
    let jobs: Vec<RenderJob<'_>> =
        (0..).zip(&maps).map(|(noise, (sensor, indentation))| job(*sensor, indentation, noise)).collect();
    let (a, b) = (CpuRenderer::new(sensors).render(&jobs).unwrap(), gpu.render(&jobs).unwrap());
    let (mut off, mut equal, mut most) = (0usize, 0usize, 0u8);
    for (n, (a, b)) in a.iter().zip(&b).enumerate() {
        let mut off_here = 0;
        for (a, b) in a.rgb.chunks_exact(3).zip(b.rgb.chunks_exact(3)) {
            let difference = (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap();
            most = most.max(difference);
            off_here += usize::from(difference > 1);
            equal += usize::from(difference == 0);
        }
        off += off_here;
        assert!(off_here * 1000 <= a.rgb.len() / 3, "image {n}: {off_here} pixels differ by more than 1 grey level");
    }
    let pixels = (a.len() * a[0].rgb.len() / 3) as f64;
    println!(
        "{}: {} images, {:.5} % of pixels equal, {:.5} % off by more than 1 grey level, {most} at most",
        gpu.device(),
        a.len(),
        100.0 * equal as f64 / pixels,
        100.0 * off as f64 / pixels
    );
    assert_eq!(a.last(), b.last(), "an idle pad is the same to the bit");
    // Idle images alone, and none at all.
    assert_eq!(gpu.render(&jobs[jobs.len() - 1..]).unwrap(), a[a.len() - 1..]);
    assert!(gpu.render(&[]).unwrap().is_empty());
    // More than one batch, and calls from several threads.
    let many = jobs[..8].repeat(40);
    std::thread::scope(|scope| {
        let calls =
            [&jobs[..8], &many[..], &jobs[..3]].map(|jobs| (jobs.len(), scope.spawn(|| gpu.render(jobs).unwrap())));
        for (count, call) in calls {
            assert!(call.join().unwrap().iter().eq(b[..8].iter().cycle().take(count)));
        }
    });
    // Without shadows the images differ: the shadows above were not empty.
    let bare = gpu.without_shadows().render(&jobs[..8]).unwrap();
    assert!(bare.iter().zip(&b).any(|(bare, b)| bare != b));
}

#[test]
fn a_software_adapter_is_no_gpu_and_bad_jobs_are_refused() {
    let hand = Hand::ftac();
    let one = Arc::new(vec![Sensor::unit(&hand.pads[0], &hand.cameras[0], 1)]);
    match GpuRenderer::new(one.clone()) {
        Err(OpticsError::Gpu(what)) => assert!(what.contains("expected a GPU"), "{what}"),
        Err(other) => panic!("{other}"),
        Ok(gpu) => assert!(!gpu.device().to_lowercase().contains("llvmpipe"), "{}", gpu.device()),
    }
    let idle = IndentationMap::idle();
    let error = CpuRenderer::new(one).render(&[job(1, &idle, 0)]).unwrap_err();
    assert!(error.to_string().contains("sensor 1"), "{error}");
}
