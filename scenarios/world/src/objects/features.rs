//! Features of an object for a learner.

use super::ObjectModel;

impl ObjectModel {
    /// Returns half of the object's extent along each axis of its frame in the resting pose (m), its mass (kg), its
    /// friction coefficient, and the height of its centre at rest (m).
    pub fn features(&self) -> [f64; 6] {
        let (points, ..) = self.shape.triangles();
        let mut half = [0.0; 3];
        for point in points {
            let turned = self.rest * point.coords;
            half.iter_mut().zip(turned.iter()).for_each(|(half, along)| *half = f64::max(*half, along.abs()));
        }
        [half[0], half[1], half[2], self.mass, self.friction, self.rest_height()]
    }
}

#[cfg(test)]
mod tests {
    use super::super::ObjectSet;

    /// A ball's extents are its radius, and so is the height at which it rests.
    #[test]
    fn features_of_a_ball() {
        let set = ObjectSet::standard();
        let ball = set.get("golf_ball").expect("a built-in object");
        let [x, y, z, mass, friction, height] = ball.features();
        assert!([x, y, z].iter().all(|half| (half - height).abs() < 0.02 * height), "{x} {y} {z} {height}");
        assert_eq!((mass, friction), (ball.mass, ball.friction));
    }
}
