//! Sets of objects, looked up by name.

use std::sync::Arc;

use super::model::ObjectModel;

/// A set of objects with unique names, in a fixed order.
#[derive(Debug, Clone, Default)]
pub struct ObjectSet {
    objects: Vec<Arc<ObjectModel>>,
}

impl ObjectSet {
    /// Adds an object. An object of the same name is replaced and returned.
    pub fn insert(&mut self, object: ObjectModel) -> Option<Arc<ObjectModel>> {
        let object = Arc::new(object);
        match self.objects.iter_mut().find(|other| other.name == object.name) {
            Some(place) => Some(std::mem::replace(place, object)),
            None => {
                self.objects.push(object);
                None
            }
        }
    }

    /// Removes the object called `name`.
    pub fn remove(&mut self, name: &str) {
        self.objects.retain(|object| object.name != name);
    }

    /// Returns the object called `name`.
    pub fn get(&self, name: &str) -> Option<&Arc<ObjectModel>> {
        self.objects.iter().find(|object| object.name == name)
    }

    /// Iterates over all objects in order.
    pub fn iter(&self) -> std::slice::Iter<'_, Arc<ObjectModel>> {
        self.objects.iter()
    }

    /// Returns all names in order.
    pub fn names(&self) -> Vec<&str> {
        self.objects.iter().map(|object| object.name.as_str()).collect()
    }
}
