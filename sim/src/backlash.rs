//! Gear backlash: the output follows the encoder, except for a gap between the teeth.
//!
//! The output has no inertia of its own beyond what it drives. A load presses it against one flank. Without a load it
//! stays in place until a flank takes it along.

/// Backlash of one gear, and the position of the output within it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Backlash {
    half: f64,
    lag: f64,
}

impl Backlash {
    /// Creates a gear with this backlash (rad at the output), its output in the middle.
    pub fn new(width: f64) -> Self {
        Self { half: 0.5 * width, lag: 0.0 }
    }

    /// Returns the lag of the output behind the encoder, rad.
    pub fn lag(&self) -> f64 {
        self.lag
    }

    /// Updates the lag after the encoder has turned by `turned` (rad) with `load` on the output (N m, positive: against
    /// positive angles).
    pub fn update(&mut self, turned: f64, load: f64) {
        if self.half == 0.0 {
            return;
        }
        self.lag =
            if load == 0.0 { (self.lag + turned).clamp(-self.half, self.half) } else { self.half.copysign(load) };
    }

    /// Returns the part of a twist (rad, encoder ahead of the driven shaft) that the backlash does not absorb, for a
    /// gear which turns `ratio` times as far.
    pub fn transmitted_twist(&mut self, twist: f64, ratio: f64) -> f64 {
        if self.half == 0.0 {
            return twist;
        }
        self.lag = (ratio * twist).clamp(-self.half, self.half);
        twist - self.lag / ratio
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: f64 = 0.0044;

    /// Turned back and forth without a load, the output lags by the backlash on the way back, and the loop is closed.
    #[test]
    fn a_turn_to_and_fro_is_a_hysteresis_of_the_play_s_width() {
        let mut play = Backlash::new(WIDTH);
        let (mut angle, mut there, mut back) = (-0.1, Vec::new(), Vec::new());
        for n in 0..3 * 400 {
            let forward = n / 400 != 1;
            let turned = if forward { 5e-4 } else { -5e-4 };
            angle += turned;
            play.update(turned, 0.0);
            let of = match n / 400 {
                0 => &mut there,
                1 => &mut back,
                _ => continue,
            };
            of.push((angle, angle - play.lag()));
        }
        let at = |path: &[(f64, f64)]| {
            path.iter().min_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).map(|(angle, output)| output - angle).unwrap()
        };
        assert!((at(&back) - at(&there) - WIDTH).abs() < 1e-12, "{} {}", at(&back), at(&there));
        assert_eq!(play.lag(), 0.5 * WIDTH);
    }

    /// A load reversal takes the output through the whole backlash; within it a shaft transmits no torque.
    #[test]
    fn a_load_presses_on_one_flank() {
        let mut play = Backlash::new(WIDTH);
        play.update(0.0, 0.1);
        let behind = play.lag();
        play.update(0.0, -0.1);
        assert!((behind - play.lag() - WIDTH).abs() < 1e-15);
        assert_eq!(play.transmitted_twist(0.4 * WIDTH, 1.0), 0.0);
        assert!((play.transmitted_twist(WIDTH, 1.0) - 0.5 * WIDTH).abs() < 1e-15);
        assert_eq!(Backlash::new(0.0).transmitted_twist(0.3, 1.0), 0.3);
    }
}
