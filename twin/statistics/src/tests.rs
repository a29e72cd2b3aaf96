use super::*;

fn close(found: f64, expected: f64, relative: f64) {
    assert!((found / expected - 1.0).abs() < relative, "found {found}, expected {expected}");
}

#[test]
fn the_t_test_agrees_with_a_known_example() {
    // differences 1 2 3 4 5: mean 3, sd sqrt(2.5), t = 3 / sqrt(0.5); p from the closed form for 4 degrees of freedom
    let pairs = [(1.0, 0.0), (3.0, 1.0), (5.0, 2.0), (7.0, 3.0), (9.0, 4.0)];
    let test = paired_t_test(&pairs);
    close(test.t.unwrap(), 3.0 / 0.5_f64.sqrt(), 1e-12);
    assert_eq!(test.df, 4);
    let x = 18.0_f64 / (4.0 + 18.0);
    let p = 0.5 * (1.0 - x.sqrt() * (1.0 + 0.5 * (1.0 - x)));
    close(test.p.unwrap(), p, 1e-9);
    let swapped = paired_t_test(&pairs.map(|(a, b)| (b, a)));
    close(swapped.p.unwrap(), 1.0 - p, 1e-9);
}

#[test]
fn the_papers_own_figures_come_out() {
    // 60 combinations with M = 0.465 and SD = 0.306 against zeros
    let half = 0.306 * (59.0_f64 / 60.0).sqrt();
    let pairs: Vec<(f64, f64)> = (0..60).map(|n| (0.465 + if n % 2 == 0 { half } else { -half }, 0.0)).collect();
    let firsts: Vec<f64> = pairs.iter().map(|pair| pair.0).collect();
    close(MeanSd::from_values(&firsts).sd.unwrap(), 0.306, 1e-12);
    let test = paired_t_test(&pairs);
    assert_eq!((test.df, (test.t.unwrap() * 10.0).round()), (59, 118.0));
    let p = test.p.unwrap();
    println!("t({}) = {}, p = {p:e}", test.df, test.t.unwrap());
    assert!((1.5e-17..3e-17).contains(&p), "{p:e}");
}

/// Regression: two combinations with equal differences once had p < 10^-300, which the report stated as significant.
#[test]
fn no_significance_comes_out_of_nothing() {
    let untested = |pairs: &[(f64, f64)]| {
        let test = paired_t_test(pairs);
        assert_eq!((test.t, test.p), (None, None), "{pairs:?}");
        assert_eq!(test.df, pairs.len().saturating_sub(1));
        (test.untested.unwrap(), test.reason().unwrap())
    };
    assert_eq!(untested(&[(1.0, 0.0); 2]), (NoTestReason::TooFew, "2 of at least 5 combinations".to_owned()));
    assert_eq!(untested(&[(1.0, 0.0), (0.9, 0.1), (1.0, 0.2), (0.9, 0.0)]).0, NoTestReason::TooFew);
    for equal in [(1.0, 0.0), (0.0, 1.0), (0.3, 0.3)] {
        assert_eq!(untested(&[equal; 60]).0, NoTestReason::NoSpread);
    }
    assert_eq!(untested(&[]), (NoTestReason::NotRun, "not run".to_owned()));
    let tested = paired_t_test(&[(1.0, 0.0), (0.9, 0.1), (1.0, 0.2), (0.9, 0.0), (0.8, 0.0)]);
    assert!(tested.p.is_some_and(|p| p < 0.05) && tested.reason().is_none());
}

#[test]
fn percentiles_lie_between_neighbours() {
    let values = [4.0, 1.0, 3.0, 2.0];
    assert_eq!(percentile(&values, 0.0), Some(1.0));
    assert_eq!(percentile(&values, 50.0), Some(2.5));
    assert_eq!(percentile(&values, 25.0), Some(1.75));
    assert_eq!(percentile(&values, 100.0), Some(4.0));
    assert_eq!(percentile(&[7.0], 99.0), Some(7.0));
    assert_eq!(percentile(&[], 50.0), None);
}

#[test]
fn boxes_and_densities() {
    let plot = box_plot(&[1.0, 2.0, 3.0, 4.0, 5.0, 100.0]).unwrap();
    assert_eq!((plot.low, plot.q1, plot.median, plot.q3, plot.high), (1.0, 2.25, 3.5, 4.75, 5.0));
    assert_eq!(plot.outliers, [100.0]);
    let values = [0.1, 0.2, 0.25, 0.7];
    let at: Vec<f64> = (0..4000).map(|n| f64::from(n) * 1e-3 - 1.5).collect();
    let integral: f64 = density(&values, silverman_bandwidth(&values, 0.01), &at).iter().sum::<f64>() * 1e-3;
    close(integral, 1.0, 1e-3);
    assert_eq!(silverman_bandwidth(&[0.5; 6], 0.02), 0.02);
}
