//! Point clouds as PLY (binary, little endian).

use super::surface::ReconstructedSurface;

/// Returns the points of the gel in contact, m, with unit normals out of the gel. The frame is that of
/// [`ReconstructedSurface`], so that pressed gel lies at negative z.
pub fn contact_points(surface: &ReconstructedSurface) -> Vec<u8> {
    let inside: Vec<usize> = (0..surface.depth.len()).filter(|&i| surface.contact[i]).collect();
    let properties: String = ["x", "y", "z", "nx", "ny", "nz"].map(|name| format!("property float {name}\n")).concat();
    let mut bytes =
        format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n{properties}end_header\n", inside.len())
            .into_bytes();
    for i in inside {
        let ([x, y], normal) = (surface.position(i), surface.normal(i));
        let values = [x as f32, y as f32, -surface.depth[i], normal[0], normal[1], normal[2]];
        bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_point_where_one_pixel_is_in_contact() {
        let mut surface = ReconstructedSurface {
            width: 3,
            height: 2,
            pixel: 1e-3,
            depth: vec![0.0; 6],
            slopes: vec![[0.0; 2]; 6],
            normal_error: vec![0.0; 6],
            contact: vec![false; 6],
            beyond: vec![false; 6],
            deepest: Some(0.5e-3),
            depth_error: None,
            notes: Vec::new(),
        };
        (surface.depth[5], surface.contact[5], surface.slopes[5]) = (0.5e-3, true, [1.0, 0.0]);
        let bytes = contact_points(&surface);
        let text = String::from_utf8_lossy(&bytes);
        let data = text.find("end_header\n").expect("a header") + "end_header\n".len();
        assert!(text.contains("element vertex 1\n"));
        let found: Vec<f32> =
            bytes[data..].chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
        let half = 0.5f32.sqrt();
        let expected = [1e-3, -0.5e-3, -0.5e-3, half, 0.0, half];
        assert!(found.len() == 6 && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-7), "{found:?}");
    }
}
