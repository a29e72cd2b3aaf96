//! One trial of the benchmark as a user runs it: ideal, blind and touch, with everything that starting the program costs, and
//! the start alone (a folder that is already finished). `cargo bench -p ftac`.

use std::path::Path;
use std::process::{Command, Stdio};

use criterion::{Criterion, criterion_group, criterion_main};

/// Runs `ftac bench` on one combination with `trials` trials into a folder of its own.
fn run(folder: &Path, more: &[&str]) {
    let status = Command::new(env!("CARGO_BIN_EXE_ftac"))
        .args(["bench", "--record", "none", "--jobs", "1", "-q"])
        .args(more)
        .arg(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .expect("ftac runs");
    // 1 says that touch did worse than blind, which a single trial may.
    assert!(matches!(status.code(), Some(0 | 1)), "{status}");
}

fn trial(criterion: &mut Criterion) {
    let scratch = tempfile::tempdir().expect("a folder");
    let mut count = 0;
    let mut fresh = || {
        count += 1;
        scratch.path().join(count.to_string())
    };
    let mut group = criterion.benchmark_group("ftac bench, combination 0");
    group.sample_size(10);
    group.bench_function("start and one trial", |bencher| {
        bencher.iter(|| run(&fresh(), &["--combos", "1", "--trials", "1", "--out"]));
    });
    let finished = scratch.path().join("finished");
    run(&finished, &["--combos", "1", "--trials", "1", "--out"]);
    group.bench_function("start alone", |bencher| bencher.iter(|| run(&finished, &["--resume"])));
    group.finish();
}

criterion_group!(benches, trial);
criterion_main!(benches);
