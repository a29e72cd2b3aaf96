//! Lens calibration of a camera from pictures of a checkerboard (Zhang 2000).
//!
//! A flat board and its image are related by a homography `H ~ K (r1 r2 t)`. Because r1 and r2 are orthogonal and of
//! equal length, every picture gives two linear equations for `K^-T K^-1`, and two or more pictures determine the
//! intrinsics K. Then intrinsics, distortion and all board poses are refined together to minimise the reprojection error
//! of the corners.

use std::path::Path;

use nalgebra::{DMatrix, Isometry3, Matrix3, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector3};

use crate::calibration::checkerboard::Checkerboard;
use crate::calibration::image_files::list_images;
use crate::calibration::lens::Lens;
use crate::calibration::photo::Photo;
use crate::error::OpticsError;
use ftac_least_squares::{FitProblem, FittedParameter, SolverOptions, forward_differences};

/// Smallest number of pictures: two determine the intrinsics, a third reveals errors.
pub const MIN_PICTURES: usize = 3;

/// A fitted lens.
#[derive(Debug, Clone, PartialEq)]
pub struct LensFit {
    /// The lens. Its third radial coefficient is 0, because corners seldom reach far enough from the centre to
    /// determine it.
    pub lens: Lens,
    /// All fitted parameters with their standard deviations.
    pub parameters: Vec<FittedParameter>,
    /// Root mean square reprojection error, pixels.
    pub residual: f64,
    /// Number of pictures.
    pub pictures: usize,
}

/// Number of lens parameters; six per picture follow them.
const LENS_PARAMETER_COUNT: usize = 8;
const PARAMETER_NAMES: [&str; LENS_PARAMETER_COUNT] = [
    "lens focal length across (px)",
    "lens focal length down (px)",
    "lens centre across (px)",
    "lens centre down (px)",
    "lens k1",
    "lens k2",
    "lens p1",
    "lens p2",
];
/// Scale of the robust loss, pixels: larger residuals count as wrongly detected corners.
const LOSS_SCALE: f64 = 1.0;

/// Fits the lens to a folder of pictures of a board, described by its `board.toml` (`columns` and `rows`: inner corners).
/// Every picture must have `size` (columns, rows) and show the whole board.
pub fn fit_folder(folder: &Path, size: [usize; 2]) -> Result<LensFit, OpticsError> {
    let path = folder.join("board.toml");
    let text = std::fs::read_to_string(&path).map_err(|error| {
        OpticsError::file(&path, format!("{error}; expected `columns` and `rows`, the board's inner corners"))
    })?;
    let board: Checkerboard = toml::from_str(&text).map_err(|error| OpticsError::file(&path, error))?;
    if board.columns < 3 || board.rows < 3 {
        let what = format!("found {} x {} inner corners; expected at least 3 x 3", board.columns, board.rows);
        return Err(OpticsError::file(&path, what));
    }
    let files = list_images(folder)?;
    if files.len() < MIN_PICTURES {
        let what = format!("found {} pictures of the checkerboard; expected at least {MIN_PICTURES}", files.len());
        return Err(OpticsError::file(folder, what));
    }
    let mut views = Vec::with_capacity(files.len());
    for file in files {
        let photo = Photo::read(&file)?;
        photo.expect_size(size, &file)?;
        views.push(board.find(&photo).map_err(|what| OpticsError::file(&file, what))?);
    }
    fit(board, &views, size).map_err(|error| OpticsError::file(folder, error))
}

/// Fits the lens to the corners of several pictures, in pixels and in the order of [`Checkerboard::find`].
pub fn fit(board: Checkerboard, views: &[Vec<[f64; 2]>], size: [usize; 2]) -> Result<LensFit, OpticsError> {
    let place = |k: usize, count: usize| k as f64 - 0.5 * (count as f64 - 1.0);
    let model: Vec<[f64; 2]> = (0..board.columns * board.rows)
        .map(|at| [place(at % board.columns, board.columns), place(at / board.columns, board.rows)])
        .collect();
    let singular = || {
        OpticsError::Calibration(
            "the pictures do not determine a camera: expected boards tilted in different directions".into(),
        )
    };
    let homographies: Option<Vec<Matrix3<f64>>> = views.iter().map(|view| homography(&model, view)).collect();
    let homographies = homographies.ok_or_else(singular)?;
    let [w, h] = size.map(|size| size as f64);
    let start = intrinsics(&homographies, size).ok_or_else(singular)?;
    let poses: Option<Vec<Isometry3<f64>>> = homographies.iter().map(|h| board_pose(&start, h)).collect();
    let poses = poses.ok_or_else(singular)?;

    let scale = w.max(h);
    let mut bounds = vec![(0.1 * scale, 20.0 * scale), (0.1 * scale, 20.0 * scale), (-w, 2.0 * w), (-h, 2.0 * h)];
    bounds.extend([(-2.0, 2.0), (-2.0, 2.0), (-0.2, 0.2), (-0.2, 0.2)]);
    bounds.extend(poses.iter().flat_map(|_| [(-1.0, 1.0); 6]));
    let mut p = vec![start[(0, 0)], start[(1, 1)], start[(0, 2)], start[(1, 2)], 0.0, 0.0, 0.0, 0.0];
    p.extend(poses.iter().flat_map(|_| [0.0; 6]));
    let residuals = |p: &[f64]| -> Vec<f64> {
        let lens = lens_from_parameters(p);
        let all = views.iter().zip(&poses).zip(p[LENS_PARAMETER_COUNT..].chunks_exact(6));
        all.flat_map(|((view, pose), q)| {
            let pose = perturb_pose(pose, q);
            model.iter().zip(view).flat_map(move |(corner, seen)| {
                let at = pose.rotation * Vector3::new(corner[0], corner[1], 0.0) + pose.translation.vector;
                let flat = [0, 1].map(|axis| lens.center[axis] + lens.focal[axis] * at[axis] / at.z.max(1e-6));
                let found = lens.distort_point(flat);
                [found[0] - seen[0], found[1] - seen[1]]
            })
        })
        .collect()
    };
    let limits = bounds.clone();
    let jacobian =
        |p: &[f64], r: &[f64]| -> DMatrix<f64> { forward_differences(p, r, &limits, 1e-7, |q, _| residuals(q)) };
    let problem = FitProblem { residuals, jacobian, bounds, groups: Vec::new() };
    let found = problem.minimise(&p, &SolverOptions { max_steps: 100, scale: LOSS_SCALE, tolerance: 1e-9 });
    let left = (problem.residuals)(&found.parameters);
    let lens = lens_from_parameters(&found.parameters);
    lens.check(size[0], size[1])?;
    let parameters = found.describe_parameters(PARAMETER_NAMES.map(str::to_owned), &problem.bounds);
    let residual = (2.0 * left.iter().map(|r| r * r).sum::<f64>() / left.len().max(1) as f64).sqrt();
    Ok(LensFit { lens, parameters, residual, pictures: views.len() })
}

fn lens_from_parameters(p: &[f64]) -> Lens {
    Lens { focal: [p[0], p[1]], center: [p[2], p[3]], radial: [p[4], p[5], 0.0], tangential: [p[6], p[7]] }
}

/// Rotates a pose by q\[0..3\] (rad) and translates it by q\[3..6\] (in units of its distance).
fn perturb_pose(pose: &Isometry3<f64>, q: &[f64]) -> Isometry3<f64> {
    let far = pose.translation.vector.norm();
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(q[0], q[1], q[2]));
    let shift = pose.translation.vector + far * Vector3::new(q[3], q[4], q[5]);
    Isometry3::from_parts(Translation3::from(shift), turn * pose.rotation)
}

/// Fits the homography from the board to an image by least squares over all corners, in normalised coordinates.
fn homography(model: &[[f64; 2]], view: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    let unit = |points: &[[f64; 2]]| -> Option<Matrix3<f64>> {
        let n = points.len() as f64;
        let [x, y] = [0, 1].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / n);
        let spread = points.iter().map(|p| (p[0] - x).hypot(p[1] - y)).sum::<f64>() / n;
        let s = 1.0 / spread;
        (spread > 0.0).then(|| Matrix3::new(s, 0.0, -s * x, 0.0, s, -s * y, 0.0, 0.0, 1.0))
    };
    let (a, b) = (unit(model)?, unit(view)?);
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (from, to) in model.iter().zip(view) {
        let (m, u) = (a * Vector3::new(from[0], from[1], 1.0), b * Vector3::new(to[0], to[1], 1.0));
        for (row, value) in [(0, u.x), (1, u.y)] {
            let mut equation = SMatrix::<f64, 9, 1>::zeros();
            for k in 0..3 {
                equation[3 * row + k] = m[k];
                equation[6 + k] = -value * m[k];
            }
            normal += equation * equation.transpose();
        }
    }
    let eigen = normal.symmetric_eigen();
    let h = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let h = Matrix3::from_fn(|row, column| h[3 * row + column]);
    Some(b.try_inverse()? * h * a)
}

/// Computes K (without skew) from the homographies; pixel coordinates are first scaled to about 1 for conditioning.
fn intrinsics(homographies: &[Matrix3<f64>], size: [usize; 2]) -> Option<Matrix3<f64>> {
    let [w, h] = size.map(|size| size as f64);
    let s = 2.0 / w.max(h);
    let unit = Matrix3::new(s, 0.0, -0.5 * s * w, 0.0, s, -0.5 * s * h, 0.0, 0.0, 1.0);
    let mut normal = SMatrix::<f64, 5, 5>::zeros();
    for homography in homographies {
        let h = unit * homography;
        let h = h / h.norm();
        // h_i^T B h_j as a linear form in B11, B22, B13, B23, B33.
        let form = |i: usize, j: usize| {
            let (a, b) = (h.column(i), h.column(j));
            SMatrix::<f64, 5, 1>::from([
                a[0] * b[0],
                a[1] * b[1],
                a[2] * b[0] + a[0] * b[2],
                a[2] * b[1] + a[1] * b[2],
                a[2] * b[2],
            ])
        };
        for equation in [form(0, 1), form(0, 0) - form(1, 1)] {
            normal += equation * equation.transpose();
        }
    }
    let eigen = normal.symmetric_eigen();
    let mut values: Vec<f64> = eigen.eigenvalues.iter().copied().collect();
    values.sort_by(f64::total_cmp);
    if values[1] < 1e-9 * values[4] {
        return None;
    }
    let b = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let (cx, cy) = (-b[2] / b[0], -b[3] / b[1]);
    let lambda = b[4] + cx * b[2] + cy * b[3];
    let (fx, fy) = ((lambda / b[0]).sqrt(), (lambda / b[1]).sqrt());
    let k = Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0);
    let k = unit.try_inverse()? * k;
    k.iter().all(|value| value.is_finite()).then_some(k)
}

/// Computes the pose of the board from its homography.
fn board_pose(k: &Matrix3<f64>, homography: &Matrix3<f64>) -> Option<Isometry3<f64>> {
    let h = k.try_inverse()? * homography;
    // The board is in front of the camera.
    let scale = 2.0 / (h.column(0).norm() + h.column(1).norm()) * h[(2, 2)].signum();
    let (r1, r2, t) = (scale * h.column(0), scale * h.column(1), scale * h.column(2));
    let rotation = Rotation3::from_matrix(&Matrix3::from_columns(&[r1, r2, r1.cross(&r2)]));
    let good = t.iter().chain(rotation.matrix().iter()).all(|value| value.is_finite());
    good.then(|| {
        Isometry3::from_parts(Translation3::from(Vector3::from(t)), UnitQuaternion::from_rotation_matrix(&rotation))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::checkerboard::tests::{BOARD, LENS, picture};

    fn poses() -> Vec<Isometry3<f64>> {
        [
            ([0.0, 0.1, 8.5], [0.4, 0.0, 0.1]),
            ([0.3, -0.2, 8.8], [-0.35, 0.25, -0.3]),
            ([-1.0, 0.4, 9.0], [0.1, -0.45, 0.6]),
            ([0.9, 0.6, 9.2], [0.3, 0.4, 1.5]),
            ([-0.6, -0.7, 8.2], [-0.25, -0.3, -0.1]),
            ([0.4, 0.0, 7.8], [0.05, 0.5, 0.2]),
        ]
        .map(|(t, r): ([f64; 3], [f64; 3])| Isometry3::new(t.into(), r.into()))
        .to_vec()
    }

    #[test]
    fn a_known_lens_is_found_from_pictures() {
        let views: Vec<_> =
            poses().iter().map(|pose| BOARD.find(&picture(BOARD, &LENS, pose, [320, 240])).unwrap()).collect();
        let found = fit(BOARD, &views, [320, 240]).unwrap();
        println!("{found:?}");
        assert!(found.residual < 0.1, "{found:?}");
        for axis in 0..2 {
            assert!((found.lens.focal[axis] / LENS.focal[axis] - 1.0).abs() < 0.005, "{found:?}");
            assert!((found.lens.center[axis] - LENS.center[axis]).abs() < 1.0, "{found:?}");
            assert!((found.lens.tangential[axis] - LENS.tangential[axis]).abs() < 2e-3, "{found:?}");
        }
        // The parameters may trade off against each other; only the mapping matters.
        for place in [[20.0, 20.0], [300.0, 20.0], [160.0, 220.0], [30.0, 215.0]] {
            let (a, b) = (LENS.distort_point(place), found.lens.distort_point(place));
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.8, "{place:?} {a:?} {b:?}");
        }
    }

    #[test]
    fn deviations_are_those_of_many_fits() {
        use rand::RngExt;
        use rand_chacha::ChaCha8Rng;
        use rand_chacha::rand_core::SeedableRng;
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut fits = Vec::new();
        for _ in 0..12 {
            let views: Vec<Vec<[f64; 2]>> = poses()
                .iter()
                .map(|pose| {
                    let corner = |at: usize| {
                        let place = |k: usize, n: usize| k as f64 - 0.5 * (n as f64 - 1.0);
                        let local = Vector3::new(place(at % 7, 7), place(at / 7, 5), 0.0);
                        let at = pose.rotation * local + pose.translation.vector;
                        let flat = [0, 1].map(|axis| LENS.center[axis] + LENS.focal[axis] * at[axis] / at.z);
                        LENS.distort_point(flat)
                            .map(|value| value + 0.1 * rng.sample::<f64, _>(rand_distr::StandardNormal))
                    };
                    (0..35).map(corner).collect()
                })
                .collect();
            fits.push(fit(BOARD, &views, [320, 240]).unwrap());
        }
        let exact = [LENS.focal[0], LENS.focal[1], LENS.center[0], LENS.center[1], LENS.radial[0]];
        for (i, exact) in exact.iter().enumerate() {
            let rms =
                |value: &dyn Fn(&LensFit) -> f64| (fits.iter().map(|f| value(f).powi(2)).sum::<f64>() / 12.0).sqrt();
            let error = rms(&|f| f.parameters[i].value - exact);
            let stated = rms(&|f| f.parameters[i].deviation.unwrap());
            assert!((0.4..2.5).contains(&(error / stated)), "{}: {error}, stated {stated}", PARAMETER_NAMES[i]);
        }
    }

    #[test]
    fn unusable_folders_are_errors_that_name_the_file() {
        let folder = std::env::temp_dir().join(format!("ftac-optics-{}-boards", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        let refusal = |named: &[&str]| {
            let text = fit_folder(&folder, [320, 240]).unwrap_err().to_string();
            assert!(named.iter().all(|part| text.contains(part)), "{text}");
        };
        refusal(&["board.toml", "columns"]);
        let board = |text: &str| std::fs::write(folder.join("board.toml"), text).unwrap();
        board("columns = 7\nrows = 5\nsquare = 3\n");
        refusal(&["board.toml", "square"]);
        board("columns = 7\nrows = 2\n");
        refusal(&["board.toml", "7 x 2", "3 x 3"]);
        board("columns = 7\nrows = 5\n");
        for (n, pose) in poses().iter().take(3).enumerate() {
            refusal(&["found", &n.to_string(), "pictures", "at least 3"]);
            picture(BOARD, &LENS, pose, [320, 240]).write(&folder.join(format!("{n}.png"))).unwrap();
        }
        assert_eq!(fit_folder(&folder, [320, 240]).unwrap().pictures, 3);
        let blank = |w: usize, h: usize| Photo { width: w, height: h, rgb: vec![99; 3 * w * h] };
        blank(320, 240).write(&folder.join("blank.png")).unwrap();
        refusal(&["blank.png", "found 0 corners", "7 x 5"]);
        blank(320, 200).write(&folder.join("blank.png")).unwrap();
        refusal(&["blank.png", "320 x 200", "320 x 240"]);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn parallel_boards_do_not_determine_a_camera() {
        let view = |far: f64| -> Vec<[f64; 2]> {
            (0..35)
                .map(|at| {
                    [160.0 + 250.0 * ((at % 7) as f64 - 3.0) / far, 120.0 + 250.0 * ((at / 7) as f64 - 2.0) / far]
                })
                .collect()
        };
        let error = fit(BOARD, &[view(8.0), view(9.0), view(11.0)], [320, 240]).unwrap_err().to_string();
        assert!(error.contains("tilted"), "{error}");
    }
}
