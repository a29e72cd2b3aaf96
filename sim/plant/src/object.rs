//! Deviations of an object from its model.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use world::geometry::GeometryError;
use world::objects::ObjectModel;

/// Factors by which an object deviates from its model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ObjectInstance {
    /// Factor on the mass, independent of the size.
    pub mass: f64,
    /// Factor on the friction coefficient.
    pub friction: f64,
    /// Factor on the size along all axes.
    pub size: f64,
}

impl ObjectInstance {
    /// An object identical to its model.
    pub const NOMINAL: Self = Self { mass: 1.0, friction: 1.0, size: 1.0 };

    /// Returns the true object for a `model`.
    pub fn apply_to(&self, model: &Arc<ObjectModel>) -> Result<Arc<ObjectModel>, GeometryError> {
        if *self == Self::NOMINAL {
            return Ok(model.clone());
        }
        Ok(Arc::new(ObjectModel {
            shape: model.shape.scaled(self.size)?,
            mass: model.mass * self.mass,
            friction: model.friction * self.friction,
            ..(**model).clone()
        }))
    }
}

#[cfg(test)]
mod tests {
    use world::objects::ObjectSet;

    use super::*;

    #[test]
    fn an_instance_rests_on_the_table_with_its_own_size() {
        let other = ObjectInstance { mass: 1.1, friction: 0.8, size: 1.03 };
        for model in ObjectSet::standard().iter() {
            let real = other.apply_to(model).unwrap();
            assert!((real.rest_height() / model.rest_height() - 1.03).abs() < 1e-6, "{}", model.name);
            assert!(
                (real.mass / model.mass - 1.1).abs() < 1e-12 && (real.friction / model.friction - 0.8).abs() < 1e-12
            );
            assert!(Arc::ptr_eq(&ObjectInstance::NOMINAL.apply_to(model).unwrap(), model));
        }
    }
}
