//! Radiance of a row of pixels under all lamps: the paper's reflectance and lamp models in single precision, laid out for
//! vectorisation. [`crate::lamps`] and [`crate::reflectance`] are the reference implementation.

use hand_model::pads::IMAGE_SIZE;

use crate::camera::Pinhole;
use crate::lamps::Lamp;
use crate::reflectance::Reflectance;
use crate::shadows::Shadow;

type PixelRow = [f32; IMAGE_SIZE];

/// The surface of one row of pixels. Only the first `len` entries are valid.
#[derive(Debug)]
pub(crate) struct SurfaceRow {
    len: usize,
    x: PixelRow,
    y: f32,
    z: PixelRow,
    /// Unit normal towards the camera.
    normal: [PixelRow; 3],
    /// Unit direction to the viewer.
    viewer: [PixelRow; 3],
    cos_r: PixelRow,
    /// Radiance in red, green and blue.
    pub(crate) radiance: [PixelRow; 3],
}

impl SurfaceRow {
    pub(crate) fn new() -> Self {
        let line = [0.0; IMAGE_SIZE];
        Self {
            len: 0,
            x: line,
            y: 0.0,
            z: line,
            normal: [line; 3],
            viewer: [line; 3],
            cos_r: line,
            radiance: [line; 3],
        }
    }

    /// Sets the row: pixel i is at (`x0 + i dx`, `y`), at height `z[i]` with slopes dz/dx and dz/dy (m, pad frame).
    #[inline(always)]
    pub(crate) fn set(&mut self, camera: &Pinhole, (x0, y): (f64, f64), dx: f64, z: &[f32], slopes: [&[f32]; 2]) {
        let n = z.len().min(IMAGE_SIZE);
        let (px, py, pz) = (camera.position.x as f32, camera.position.y as f32, camera.position.z as f32);
        self.len = n;
        self.y = y as f32;
        for (k, start) in (0..n).step_by(LANES).enumerate() {
            let lanes = |line: &[f32]| {
                let mut lanes = [0.0f32; LANES];
                let part = &line[start..n.min(start + LANES)];
                lanes[..part.len()].copy_from_slice(part);
                lanes
            };
            let (z, zx, zy) = (lanes(z), lanes(slopes[0]), lanes(slopes[1]));
            let mut line = [0.0; LANES];
            let (mut normal, mut viewer, mut cos_r) = ([line; 3], [line; 3], line);
            for i in 0..LANES {
                let x = x0 as f32 + (start as i32 + i as i32) as f32 * dx as f32;
                line[i] = x;
                let inverse = 1.0 / (zx[i] * zx[i] + zy[i] * zy[i] + 1.0).sqrt();
                let n = [zx[i] * inverse, zy[i] * inverse, -inverse];
                let v = [px - x, py - self.y, pz - z[i]];
                let inverse = 1.0 / (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
                let v = v.map(|v| v * inverse);
                cos_r[i] = n[0] * v[0] + n[1] * v[1] + n[2] * v[2];
                for axis in 0..3 {
                    (normal[axis][i], viewer[axis][i]) = (n[axis], v[axis]);
                }
            }
            let set = |into: &mut PixelRow, lanes: [f32; LANES]| into.as_chunks_mut::<LANES>().0[k] = lanes;
            set(&mut self.x, line);
            set(&mut self.z, z);
            set(&mut self.cos_r, cos_r);
            self.normal.iter_mut().zip(normal).for_each(|(into, lanes)| set(into, lanes));
            self.viewer.iter_mut().zip(viewer).for_each(|(into, lanes)| set(into, lanes));
        }
    }
}

/// A lamp with its constant factors precomputed.
#[derive(Debug, Clone)]
struct ShadedLamp {
    position: [f32; 3],
    direction: [f32; 3],
    mu: f32,
    /// Power, eta * color * albedo * gain / pi.
    power: [f32; 3],
}

/// All lamps and the coating of one camera unit.
#[derive(Debug, Clone)]
pub(crate) struct Shading {
    lamps: Vec<ShadedLamp>,
    ambient: [f32; 3],
    a: f32,
    b: f32,
}

impl Shading {
    pub(crate) fn new(lamps: &[Lamp], reflectance: &Reflectance, gain: [f64; 3], ambient: [f64; 3]) -> Self {
        let single = |v: &[f64]| -> [f32; 3] { std::array::from_fn(|i| v[i] as f32) };
        let lamps = lamps
            .iter()
            .map(|lamp| ShadedLamp {
                position: single(lamp.position.coords.as_slice()),
                direction: single(lamp.direction.as_slice()),
                mu: lamp.mu as f32,
                power: std::array::from_fn(|c| {
                    (lamp.eta * lamp.color[c] * reflectance.albedo[c] * gain[c] / std::f64::consts::PI) as f32
                }),
            })
            .collect();
        Self { lamps, ambient: single(&ambient), a: reflectance.a() as f32, b: reflectance.b() as f32 }
    }

    /// Returns each lamp's power in each channel.
    #[cfg(feature = "gpu")]
    pub(crate) fn powers(&self) -> impl Iterator<Item = [f32; 3]> {
        self.lamps.iter().map(|lamp| lamp.power)
    }

    /// Fills `row.radiance` with the sum over all lamps. `shadows` is empty or has an element per lamp; the row is their row
    /// `place.1` from column `place.0` on.
    #[inline(always)]
    pub(crate) fn shade(&self, row: &mut SurfaceRow, shadows: &[Option<Shadow>], place: (usize, usize)) {
        for (line, ambient) in row.radiance.iter_mut().zip(self.ambient) {
            line[..row.len].iter_mut().zip(&row.normal[2]).for_each(|(sum, nz)| *sum = ambient * 0.5 * (1.0 - nz));
        }
        let mut light = [0.0; IMAGE_SIZE];
        let mut share = [0.0; IMAGE_SIZE];
        for (k, lamp) in self.lamps.iter().enumerate() {
            self.lamp_light(lamp, row, &mut light);
            if let Some(shadow) = shadows.get(k).and_then(Option::as_ref) {
                shadow.row(place.1, place.0, &mut share[..row.len]);
                light[..row.len].iter_mut().zip(&share).for_each(|(light, share)| *light *= share);
            }
            for (line, power) in row.radiance.iter_mut().zip(lamp.power) {
                if power != 0.0 {
                    line[..row.len].iter_mut().zip(&light).for_each(|(sum, light)| *sum += power * light);
                }
            }
        }
    }

    /// Computes `(-s . p)^mu / |s|^2 * max(0, cos theta_i) * f_r` of one lamp along the row, [`LANES`] pixels at a
    /// time; values beyond the row's end are not used.
    #[inline(always)]
    fn lamp_light(&self, lamp: &ShadedLamp, row: &SurfaceRow, light: &mut PixelRow) {
        let ([lx, ly, lz], [px, py, pz]) = (lamp.position, lamp.direction);
        let sy = ly - row.y;
        let lanes = |line: &PixelRow, k: usize| line.as_chunks::<LANES>().0[k];
        for (k, light) in light.as_chunks_mut::<LANES>().0.iter_mut().enumerate().take(row.len.div_ceil(LANES)) {
            let (x, z, cos_r) = (lanes(&row.x, k), lanes(&row.z, k), lanes(&row.cos_r, k));
            let [nx, ny, nz] = row.normal.each_ref().map(|line| lanes(line, k));
            let [vx, vy, vz] = row.viewer.each_ref().map(|line| lanes(line, k));
            let mut out = [0.0; LANES];
            for i in 0..LANES {
                let (sx, sz) = (lx - x[i], lz - z[i]);
                let inverse_square = 1.0 / (sx * sx + sy * sy + sz * sz);
                let inverse = inverse_square.sqrt();
                let (sx, sy, sz) = (sx * inverse, sy * inverse, sz * inverse);
                let along = -(sx * px + sy * py + sz * pz);
                let kappa = power(along, lamp.mu) * inverse_square;
                let cos_i = (nx[i] * sx + ny[i] * sy + nz[i] * sz).max(0.0);
                let across = (sx * vx[i] + sy * vy[i] + sz * vz[i] - cos_i * cos_r[i]).max(0.0);
                let larger = cos_i.max(cos_r[i]).max(1e-3);
                out[i] = kappa * cos_i * (self.a + self.b * across / larger);
            }
            *light = out;
        }
    }
}

/// Number of pixels computed at once.
const LANES: usize = 16;
const _: () = assert!(IMAGE_SIZE.is_multiple_of(LANES));

/// Computes `base^exponent` for a base up to 1 (0 for a base of 0 or less) to about 1e-4, in arithmetic that
/// vectorises.
#[inline(always)]
fn power(base: f32, exponent: f32) -> f32 {
    const ROUNDING_OFFSET: f32 = 12_582_912.0; // 1.5 * 2^23: adding it rounds to a whole number, left in the low bits.
    let bits = base.max(1e-6).to_bits();
    let whole = ((bits >> 23) as i32 - 127) as f32;
    let m = f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000);
    // Minimax polynomial of log2(m) / (m - 1) on [1, 2).
    let p = -0.034_436_006_f32;
    let p = p * m + 0.318_213_37;
    let p = p * m - 1.231_530_3;
    let p = p * m + 2.598_845_2;
    let p = p * m - 3.324_199;
    let p = p * m + 3.115_79;
    let y = (exponent * (whole + p * (m - 1.0))).max(-100.0);
    let shifted = y + ROUNDING_OFFSET;
    let f = y - (shifted - ROUNDING_OFFSET);
    let two = f32::from_bits((shifted.to_bits().wrapping_sub(ROUNDING_OFFSET.to_bits()).wrapping_add(127)) << 23);
    // Taylor series of 2^f on [-0.5, 0.5].
    let q = 0.001_333_355_8_f32;
    let q = q * f + 0.009_618_129;
    let q = q * f + 0.055_504_11;
    let q = q * f + 0.240_226_5;
    let q = q * f + std::f32::consts::LN_2;
    let q = q * f + 1.0;
    // A mask, because a branch would prevent vectorisation.
    let mask = if base > 0.0 { u32::MAX } else { 0 };
    f32::from_bits((two * q).to_bits() & mask)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn power_agrees_with_the_standard_library() {
        for exponent in [0.0f32, 0.5, 1.0, 1.2, 3.7, 6.0] {
            for i in 1..=1000 {
                let base = i as f32 / 1000.0;
                let exact = base.powf(exponent);
                assert!((power(base, exponent) - exact).abs() < 3e-4 * exact + 1e-9, "{base}^{exponent}");
            }
        }
        assert_eq!(power(-0.1, 1.0), 0.0);
    }

    proptest! {
        #[test]
        fn fast_shading_is_the_reference(
            [x, y, z] in [-0.01..0.01, -0.02..0.02, -0.0025..0.0], [zx, zy] in [-1.2..1.2, -1.2..1.2], roughness in 0.0..0.8, mu in 0.0..5.0,
        ) {
            let lamp = Lamp::aimed(Point3::new(0.012, 0.003, -0.01), Point3::new(-0.004, 0.0, 0.0), 1.3, mu, [1.0, 0.2, 0.5]);
            let reflectance = Reflectance { albedo: [0.9, 0.8, 0.7], roughness };
            let camera = Pinhole { position: Point3::new(0.0, 0.001, -0.016) };
            let mut row = SurfaceRow::new();
            row.set(&camera, (x, y), 1e-4, &[z as f32], [&[zx as f32], &[zy as f32]]);
            Shading::new(&[lamp], &reflectance, [1.0; 3], [40.0, 0.0, 200.0]).shade(&mut row, &[], (0, 0));
            let point = Point3::new(x, y, z);
            let (s, kappa) = lamp.direction_and_irradiance(&point);
            // With an exponent near 0 a lamp's light ends abruptly to its side, where rounding decides.
            prop_assume!(s.dot(&lamp.direction).abs() > 1e-5);
            let exact = reflectance.radiance(kappa, &Vector3::new(zx, zy, -1.0).normalize(), &s, &camera.direction_to_camera(&point));
            for c in 0..3 {
                let open = 0.5 * (1.0 + 1.0 / (1.0 + zx * zx + zy * zy).sqrt());
                let exact = exact[c] * lamp.color[c] + open * [40.0, 0.0, 200.0][c];
                prop_assert!((f64::from(row.radiance[c][0]) - exact).abs() < 1e-3 * exact + 0.5, "{} {}", row.radiance[c][0], exact);
            }
        }
    }
}
