//! The presses as the fit models them: rotationally symmetric profiles instead of height maps, so that a pixel costs a
//! few operations.
//!
//! The image formation is the renderer's: a pixel's ray meets the displaced gel (relief), lamps light that point unless
//! the bump occludes them, and `image = F(G(background) + L(deformed) - L(flat))`.

use nalgebra::{DMatrix, Point3, Vector3};
use rayon::prelude::*;

use crate::calibration::assumptions::Assumptions;
use crate::calibration::parameters::{self as at, PARAMETERS_PER_LAMP};
use crate::calibration::profile::{BallProfile, RoundSmoothing};
use crate::calibration::samples::FitSamples;
use crate::lamps::Lamp;
use ftac_least_squares::forward_differences;

/// Radius up to which a press deforms the gel, and the step of its profile, m.
const PROFILE_REACH: f64 = 6e-3;
const PROFILE_STEP: f64 = 0.04e-3;
/// Weight of the background's grey levels relative to those of the presses, because the background contains scratches
/// and stray light.
const BACKGROUND_WEIGHT: f64 = 0.3;
/// Number of points on the line to a lamp that are tested for occlusion.
const OCCLUSION_SAMPLES: usize = 24;

/// A point on the gel, with the slopes dz/dx and dz/dy.
#[derive(Debug, Clone, Copy)]
struct GelPoint {
    point: Point3<f64>,
    slope: [f64; 2],
}

/// Intersections of the samples' rays with the gel.
#[derive(Debug)]
pub(crate) struct GelSurface {
    profiles: Vec<BallProfile>,
    centers: Vec<[f64; 2]>,
    deformed: Vec<GelPoint>,
    undeformed: Vec<Point3<f64>>,
    flat: Vec<Point3<f64>>,
}

/// Light of one lamp of colour 1 at the touched samples on the deformed and on the flat gel, and at the background's samples.
#[derive(Debug, Clone)]
struct LampLight {
    deformed: Vec<f64>,
    undeformed: Vec<f64>,
    flat: Vec<f64>,
}

/// Samples and the model's assumptions.
#[derive(Debug)]
pub(crate) struct CalibrationScene<'a> {
    pub(crate) samples: &'a FitSamples,
    pub(crate) assumptions: &'a Assumptions,
}

impl CalibrationScene<'_> {
    /// Computes the residuals in grey levels, three per sample: the touched samples, then the background's, then the
    /// background's under each lamp alone.
    pub(crate) fn residuals(&self, p: &[f64]) -> Vec<f64> {
        let surface = self.surface(p);
        let lights = self.lights(&surface, p);
        self.compare(&surface, &lights.iter().collect::<Vec<_>>(), p)
    }

    /// Predicts the grey levels (0 to 1) of the touched samples.
    pub(crate) fn predict(&self, p: &[f64]) -> Vec<[f64; 3]> {
        let surface = self.surface(p);
        let lights = self.lights(&surface, p);
        self.grey(&surface, &lights.iter().collect::<Vec<_>>(), p)
    }

    /// Computes the Jacobian of the residuals. A lamp's geometry affects that lamp's light only, so the other lamps are
    /// not evaluated again.
    pub(crate) fn jacobian(&self, p: &[f64], residuals: &[f64], bounds: &[(f64, f64)]) -> DMatrix<f64> {
        let surface = self.surface(p);
        let lights = self.lights(&surface, p);
        let all: Vec<&LampLight> = lights.iter().collect();
        forward_differences(p, residuals, bounds, 1e-6, |q, j| {
            if j < at::RESPONSE {
                return self.residuals(q);
            }
            let (lamp, part) = (
                (j.max(at::FIRST_LAMP) - at::FIRST_LAMP) / PARAMETERS_PER_LAMP,
                (j.max(at::FIRST_LAMP) - at::FIRST_LAMP) % PARAMETERS_PER_LAMP,
            );
            if j < at::FIRST_LAMP || part >= at::COLOR_OFFSET {
                return self.compare(&surface, &all, q);
            }
            let moved = self.light(&surface, q, lamp);
            let mut some = all.clone();
            some[lamp] = &moved;
            self.compare(&surface, &some, q)
        })
    }

    /// Returns the index of the first residual of each press, of the background, and of each single lamp's image.
    pub(crate) fn groups(&self) -> Vec<usize> {
        let touched = &self.samples.touched;
        let mut starts: Vec<usize> =
            (0..touched.len()).filter(|&i| i == 0 || touched[i].press != touched[i - 1].press).map(|i| 3 * i).collect();
        if !self.samples.flat.is_empty() {
            let flat = 3 * self.samples.flat.len();
            starts.extend((0..=self.samples.single_lamp_values.len()).map(|image| 3 * touched.len() + flat * image));
        }
        starts
    }

    fn surface(&self, p: &[f64]) -> GelSurface {
        let (samples, pixel, camera) = (self.samples, p[at::PIXEL], at::camera(p).position);
        let elastomer = at::elastomer(p);
        let smoothing = RoundSmoothing::new(&elastomer.kernels, PROFILE_REACH, PROFILE_STEP);
        let plane = |place: [f64; 2]| {
            let [w, h] = samples.size.map(|size| 0.5 * (size as f64 - 1.0));
            [(place[0] - w) * pixel, (h - place[1]) * pixel]
        };
        // A point at depth d on the ray through the plane's q.
        let relief = |q: [f64; 2], depth: f64| {
            let part = -depth / camera.z;
            [q[0] + (camera.x - q[0]) * part, q[1] + (camera.y - q[1]) * part]
        };
        let mut known: Vec<(f64, f64, BallProfile)> = Vec::new();
        let (mut profiles, mut centers) = (Vec::new(), Vec::new());
        for mark in &samples.marks {
            let old = known.iter().position(|(radius, ball, _)| *radius == mark.radius && *ball == mark.ball);
            let index = old.unwrap_or_else(|| {
                let contact = mark.radius * pixel * p[at::CONTACT];
                known.push((mark.radius, mark.ball, smoothing.press(mark.ball + elastomer.coating, contact)));
                known.len() - 1
            });
            let profile = known[index].2.clone();
            // The visible circle lies on the bump, not on the plane.
            centers.push(relief(plane(mark.center), profile.depth_and_slope(mark.radius * pixel).0));
            profiles.push(profile);
        }
        let meet = |sample: &super::samples::PixelSample| {
            let (q, c, profile) = (plane(sample.place), centers[sample.press], &profiles[sample.press]);
            let (mut x, mut depth, mut per_metre) = (q, 0.0, 0.0);
            for _ in 0..5 {
                x = relief(q, depth);
                let r = (x[0] - c[0]).hypot(x[1] - c[1]);
                let (d, slope) = profile.depth_and_slope(r);
                (depth, per_metre) = (d, if r > 1e-9 { slope / r } else { 0.0 });
            }
            let slope = [-per_metre * (x[0] - c[0]), -per_metre * (x[1] - c[1])];
            GelPoint { point: Point3::new(x[0], x[1], -depth), slope }
        };
        let on_plane = |sample: &super::samples::PixelSample| {
            let q = plane(sample.place);
            Point3::new(q[0], q[1], 0.0)
        };
        let deformed = samples.touched.iter().map(meet).collect();
        let undeformed = samples.touched.iter().map(on_plane).collect();
        let flat = samples.flat.iter().map(on_plane).collect();
        GelSurface { profiles, centers, deformed, undeformed, flat }
    }

    fn lights(&self, surface: &GelSurface, p: &[f64]) -> Vec<LampLight> {
        (0..(p.len() - at::FIRST_LAMP) / PARAMETERS_PER_LAMP).map(|k| self.light(surface, p, k)).collect()
    }

    fn light(&self, surface: &GelSurface, p: &[f64], k: usize) -> LampLight {
        let (lamp, reflectance, camera) =
            (at::lamp(p, k, self.assumptions.near_field), at::reflectance(p), at::camera(p));
        let shade = |point: &Point3<f64>, slope: [f64; 2]| {
            let (s, kappa) = lamp.direction_and_irradiance(point);
            let normal = Vector3::new(slope[0], slope[1], -1.0).normalize();
            kappa * reflectance.factor(&normal, &s, &camera.direction_to_camera(point))
        };
        let deformed = |(place, sample): (&GelPoint, &super::samples::PixelSample)| {
            let light = shade(&place.point, place.slope);
            if light > 0.0 && self.assumptions.shadows {
                light * visible(&surface.profiles[sample.press], surface.centers[sample.press], &place.point, &lamp)
            } else {
                light
            }
        };
        LampLight {
            deformed: surface.deformed.par_iter().zip(&self.samples.touched).with_min_len(512).map(deformed).collect(),
            undeformed: surface.undeformed.iter().map(|point| shade(point, [0.0; 2])).collect(),
            flat: surface.flat.iter().map(|point| shade(point, [0.0; 2])).collect(),
        }
    }

    fn grey(&self, surface: &GelSurface, lights: &[&LampLight], p: &[f64]) -> Vec<[f64; 3]> {
        let responses: [_; 3] = std::array::from_fn(|c| at::response(p, c));
        let color = |k: usize, c: usize| p[at::FIRST_LAMP + PARAMETERS_PER_LAMP * k + at::COLOR_OFFSET + c];
        let pixel = |i: usize| {
            let [zx, zy] = surface.deformed[i].slope;
            let open = 0.5 * (1.0 / (1.0 + zx * zx + zy * zy).sqrt() - 1.0);
            std::array::from_fn(|c| {
                let change = |(k, light): (usize, &&LampLight)| color(k, c) * (light.deformed[i] - light.undeformed[i]);
                let change = lights.iter().enumerate().map(change).sum::<f64>() + open * p[at::AMBIENT + c];
                responses[c].measured(responses[c].radiance(self.samples.touched[i].background[c]) + change)
            })
        };
        (0..surface.deformed.len()).into_par_iter().with_min_len(512).map(pixel).collect()
    }

    /// Predicts the grey levels of the background's pixels from the model alone.
    fn flat(&self, lights: &[&LampLight], p: &[f64]) -> Vec<[f64; 3]> {
        let color = |k: usize, c: usize| p[at::FIRST_LAMP + PARAMETERS_PER_LAMP * k + at::COLOR_OFFSET + c];
        let responses: [_; 3] = std::array::from_fn(|c| at::response(p, c));
        let radiance = |i: usize, c: usize| {
            lights.iter().enumerate().map(|(k, light)| color(k, c) * light.flat[i]).sum::<f64>() + p[at::AMBIENT + c]
        };
        (0..self.samples.flat.len()).map(|i| std::array::from_fn(|c| responses[c].measured(radiance(i, c)))).collect()
    }

    /// Predicts the grey levels of the background's pixels under lamp group `image` of `images`. Lamps are in the order
    /// of the images, the same number for each. Diffuse light is scattered light of the lamps: in each channel, a lamp
    /// contributes in proportion to its colour.
    fn alone(&self, lights: &[&LampLight], p: &[f64], image: usize, images: usize) -> Vec<[f64; 3]> {
        let color = |k: usize, c: usize| p[at::FIRST_LAMP + PARAMETERS_PER_LAMP * k + at::COLOR_OFFSET + c];
        let responses: [_; 3] = std::array::from_fn(|c| at::response(p, c));
        let own = || (0..lights.len()).filter(|k| k * images / lights.len() == image);
        let diffuse: [f64; 3] = std::array::from_fn(|c| {
            let all: f64 = (0..lights.len()).map(|k| color(k, c)).sum();
            p[at::AMBIENT + c] * own().map(|k| color(k, c)).sum::<f64>() / all.max(f64::MIN_POSITIVE)
        });
        let radiance = |i: usize, c: usize| diffuse[c] + own().map(|k| color(k, c) * lights[k].flat[i]).sum::<f64>();
        (0..self.samples.flat.len()).map(|i| std::array::from_fn(|c| responses[c].measured(radiance(i, c)))).collect()
    }

    /// Predicts the grey levels (0 to 1) of the background's pixels under each of `images` lamps alone.
    pub(crate) fn predict_alone(&self, p: &[f64], images: usize) -> Vec<Vec<[f64; 3]>> {
        let surface = self.surface(p);
        let lights = self.lights(&surface, p);
        let lights: Vec<&LampLight> = lights.iter().collect();
        (0..images).map(|image| self.alone(&lights, p, image, images)).collect()
    }

    /// Predicts the grey levels (0 to 1) of the background's pixels.
    pub(crate) fn predict_flat(&self, p: &[f64]) -> Vec<[f64; 3]> {
        let surface = self.surface(p);
        self.flat(&self.lights(&surface, p).iter().collect::<Vec<_>>(), p)
    }

    fn compare(&self, surface: &GelSurface, lights: &[&LampLight], p: &[f64]) -> Vec<f64> {
        let grey = self.grey(surface, lights, p);
        let touched = self.samples.touched.iter().zip(&grey);
        let mut residuals: Vec<f64> =
            touched.flat_map(|(sample, grey)| (0..3).map(move |c| 255.0 * (grey[c] - sample.value[c]))).collect();
        for (sample, grey) in self.samples.flat.iter().zip(self.flat(lights, p)) {
            residuals.extend((0..3).map(|c| BACKGROUND_WEIGHT * 255.0 * (grey[c] - sample.background[c])));
        }
        let images = self.samples.single_lamp_values.len();
        for (image, seen) in self.samples.single_lamp_values.iter().enumerate() {
            for (seen, grey) in seen.iter().zip(self.alone(lights, p, image, images)) {
                residuals.extend((0..3).map(|c| BACKGROUND_WEIGHT * 255.0 * (grey[c] - seen[c])));
            }
        }
        residuals
    }
}

/// Computes the share of a lamp that is visible from a point on the gel over the bump around `center`.
fn visible(profile: &BallProfile, center: [f64; 2], point: &Point3<f64>, lamp: &Lamp) -> f64 {
    let (dx, dy) = (lamp.position.x - point.x, lamp.position.y - point.y);
    let distance = dx.hypot(dy).max(1e-6);
    let (x, y) = (point.x - center[0], point.y - center[1]);
    let along = (x * dx + y * dy) / distance;
    let across = x * x + y * y - along * along;
    let reach = profile.reach();
    let half = (reach * reach - across).max(0.0).sqrt();
    let (enters, leaves) = ((-along - half).max(0.0), (half - along).min(distance));
    if leaves <= enters {
        return 1.0;
    }
    let mut horizon = 0.0f64;
    for i in 0..OCCLUSION_SAMPLES {
        let t = enters + (leaves - enters) * (i as f64 + 0.7) / OCCLUSION_SAMPLES as f64;
        let depth = profile.depth_and_slope(((along + t) * (along + t) + across).sqrt()).0;
        horizon = horizon.max((depth + point.z) / t);
    }
    lamp.visible_share(horizon, (point.z - lamp.position.z) / distance, distance)
}
