//! Object properties of a search: the mass for which grasps are verified, and their payloads.

use schemars::JsonSchema;
use serde::Serialize;
use world::objects::ObjectModel;

/// Mass and friction of a search, with the payloads of its verified grasps.
#[derive(Debug, Clone, Default, PartialEq, Serialize, JsonSchema)]
pub struct ObjectProperties {
    /// Mass of the object, kg.
    pub mass: f64,
    /// Coulomb coefficient between hand and object.
    pub friction: f64,
    /// Least, median and largest payload of the grasps, kg. `None` without grasps.
    pub payload: Option<[f64; 3]>,
}

impl ObjectProperties {
    /// Summarizes grasps of `model` with these payloads (kg).
    pub fn summarize(model: &ObjectModel, payloads: impl Iterator<Item = f64>) -> Self {
        let mut payloads: Vec<f64> = payloads.collect();
        payloads.sort_by(f64::total_cmp);
        let payload = match &payloads[..] {
            [] => None,
            sorted => Some([sorted[0], sorted[sorted.len() / 2], sorted[sorted.len() - 1]]),
        };
        Self { mass: model.mass, friction: model.friction, payload }
    }

    /// Formats the properties as text.
    pub fn text(&self) -> String {
        let grams = |kg: f64| format!("{:.*} g", if kg < 0.01 { 1 } else { 0 }, 1e3 * kg);
        let range = self.payload.map_or(String::new(), |[least, median, most]| {
            format!("; payload {}, {} to {}", grams(median), grams(least), grams(most))
        });
        format!("verified for      {}, friction {}{range}", grams(self.mass), self.friction)
    }
}
