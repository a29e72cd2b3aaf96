//! The paper's two tables of sensors, with this hand's figures computed from its model.

use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE;
use schemars::JsonSchema;
use serde::Serialize;

/// One of the six sensor configurations.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct SensorConfiguration {
    /// Letter of the configuration, `a` to `f`.
    pub letter: char,
    /// Number of pads on the hand.
    pub pads: usize,
    /// Cameras per pad.
    pub cameras: usize,
    /// Height and width, mm.
    pub size_mm: [f64; 2],
    /// Pixels per square centimetre.
    pub taxels_per_cm2: f64,
}

/// The whole hand as a tactile array.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct TactileArray {
    pub configurations: Vec<SensorConfiguration>,
    /// Number of pads.
    pub pads: usize,
    /// Number of cameras.
    pub cameras: usize,
    /// Sensing area, cm2.
    pub area_cm2: f64,
    /// Pixels of all cameras.
    pub taxels: usize,
    /// Pixels per square centimetre, mean over the area.
    pub taxels_per_cm2: f64,
    /// Mean distance of neighbouring pixels, mm.
    pub pitch_mm: f64,
}

/// Computes the figures of the tables for `hand`.
pub fn tactile_array(hand: &Hand) -> TactileArray {
    let mut configurations: Vec<SensorConfiguration> = Vec::new();
    for pad in &hand.pads {
        match configurations.iter_mut().find(|known| known.letter == pad.configuration) {
            Some(known) => known.pads += 1,
            None => configurations.push(SensorConfiguration {
                letter: pad.configuration,
                pads: 1,
                cameras: pad.cameras.len(),
                size_mm: [1e3 * pad.h, 1e3 * pad.w],
                taxels_per_cm2: (pad.cameras.len() * IMAGE_SIZE * IMAGE_SIZE) as f64 / (1e4 * pad.h * pad.w),
            }),
        }
    }
    configurations.sort_by_key(|configuration| configuration.letter);
    let area: f64 = hand.pads.iter().map(|pad| pad.h * pad.w).sum();
    let taxels = hand.cameras.len() * IMAGE_SIZE * IMAGE_SIZE;
    let density = taxels as f64 / (1e4 * area);
    TactileArray {
        configurations,
        pads: hand.pads.len(),
        cameras: hand.cameras.len(),
        area_cm2: 1e4 * area,
        taxels,
        taxels_per_cm2: density,
        pitch_mm: 10.0 / density.sqrt(),
    }
}

/// Another system in the paper's table: name, sensing area, resolution, transduction, wiring, sensitivity per kPa.
pub type TactileSystem = [&'static str; 6];

/// The paper's table of other tactile arrays.
pub const OTHER_SYSTEMS: [TactileSystem; 6] = [
    ["Yu et al. 2022", "full hand", "21 taxels a hand", "piezoresistive", "per taxel", "-"],
    ["Luo et al. 2021", "full hand", "4.5 taxels/cm2", "piezoresistive", "per taxel", "-"],
    ["Li et al. 2020", "fingers", "10 taxels a hand", "piezothermic", "per taxel", "117 mV"],
    ["Lee et al. 2019", "full hand", "23 taxels/cm2", "resistive", "per taxel", "-"],
    ["Sundaram et al. 2019", "full hand", "548 taxels a hand", "piezoresistive", "per taxel", "-"],
    ["Kim et al. 2014", "full hand", "2 taxels/cm2", "piezoresistive", "per taxel", "0.41"],
];

#[cfg(test)]
mod tests {
    use super::*;

    /// The dimensions are those of the paper's table, and the pixels add up.
    #[test]
    fn tables_of_the_hand() {
        let found = tactile_array(&Hand::ftac());
        let sizes: Vec<_> =
            found.configurations.iter().map(|c| (c.letter, c.cameras, c.size_mm.map(f64::round))).collect();
        assert_eq!(
            sizes,
            [
                ('a', 1, [33.0, 20.0]),
                ('b', 1, [29.0, 20.0]),
                ('c', 1, [41.0, 20.0]),
                ('d', 1, [45.0, 25.0]),
                ('e', 1, [48.0, 29.0]),
                ('f', 2, [69.0, 47.0]),
            ]
        );
        let sum: f64 = found
            .configurations
            .iter()
            .map(|c| c.pads as f64 * c.taxels_per_cm2 * c.size_mm[0] * c.size_mm[1] / 100.0)
            .sum();
        assert!((sum - found.taxels as f64).abs() < 1.0 && found.taxels == 18 * 57600);
        // One pad of 33 x 20 mm under 240 x 240 pixels.
        assert!((found.configurations[0].taxels_per_cm2 - 57600.0 / 6.6).abs() < 1e-6);
    }
}
