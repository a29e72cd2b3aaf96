//! Pixels of a triangle.

/// Columns up to which all pixels of a triangle's box are tried.
const NARROW_COLUMNS: u32 = 6;

/// Calls `draw` with the index of every pixel of a triangle in a picture of `size` pixels (width, height), and with the
/// barycentric weights of its corners there. Corners are (column, row, anything).
pub fn pixels(size: [u32; 2], [a, b, c]: [[f64; 3]; 3], mut draw: impl FnMut(usize, [f64; 3])) {
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    if area.abs() < 1e-9 {
        return;
    }
    let per_area = 1.0 / area;
    let span = |axis: usize| {
        let limit = f64::from(size[axis] - 1);
        let low = a[axis].min(b[axis]).min(c[axis]).ceil().clamp(0.0, limit);
        let high = a[axis].max(b[axis]).max(c[axis]).floor().clamp(0.0, limit);
        (low as u32, high as u32)
    };
    let ((x0, x1), (y0, y1)) = (span(0), span(1));
    let weights = |px: f64, py: f64| {
        let u = ((px - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (py - a[1])) * per_area;
        let v = ((b[0] - a[0]) * (py - a[1]) - (px - a[0]) * (b[1] - a[1])) * per_area;
        [1.0 - u - v, u, v]
    };
    // Change of the weights from a column to the next.
    let [by_u, by_v] = [(c[1] - a[1]) * per_area, (a[1] - b[1]) * per_area];
    let slopes = [-by_u - by_v, by_u, by_v];
    for y in y0..=y1 {
        // A long slanted triangle covers a small part of its box: the columns in which no weight is negative, and one
        // more on each side for rounding.
        let (mut first, mut last) = (x0, x1);
        if x1 - x0 > NARROW_COLUMNS {
            for (weight, slope) in weights(f64::from(x0), f64::from(y)).into_iter().zip(slopes) {
                let zero = f64::from(x0) - weight / slope;
                if slope > 0.0 {
                    first = first.max((zero - 1.0) as u32);
                } else if slope < 0.0 {
                    last = last.min((zero + 2.0) as u32);
                }
            }
        }
        for x in first..=last {
            let [w, u, v] = weights(f64::from(x), f64::from(y));
            if u >= 0.0 && v >= 0.0 && w >= 0.0 {
                draw((y * size[0] + x) as usize, [w, u, v]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle covers the pixels whose middles are in it, also a long slanted one that is wider than the picture.
    #[test]
    fn triangles_cover_what_is_in_them() {
        let size = [80, 80];
        let triangles = [
            [[3.2, 70.1], [75.9, 4.3], [78.2, 5.1]],
            [[-300.0, 20.0], [500.0, 60.5], [300.0, 60.0]],
            [[10.0, 10.0], [10.0, 70.0], [60.0, 10.0]],
            [[20.3, 20.1], [23.9, 21.7], [21.0, 25.2]],
            [[5.0, 30.2], [70.0, 30.4], [40.0, 30.6]],
        ];
        for corners in triangles {
            let mut covered = vec![false; 80 * 80];
            pixels(size, corners.map(|[x, y]| [x, y, 0.0]), |index, _| covered[index] = true);
            for (index, covered) in covered.into_iter().enumerate() {
                let (x, y) = ((index % 80) as f64, (index / 80) as f64);
                let sides = [0, 1, 2].map(|n| {
                    let ([ax, ay], [bx, by]) = (corners[n], corners[(n + 1) % 3]);
                    (bx - ax) * (y - ay) - (by - ay) * (x - ax)
                });
                let (least, most) = (
                    sides.iter().copied().fold(f64::INFINITY, f64::min),
                    sides.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                );
                if least > 1e-6 || most < -1e-6 {
                    assert!(covered, "{corners:?}: {x}, {y}");
                } else if least < -1e-6 && most > 1e-6 {
                    assert!(!covered, "{corners:?}: {x}, {y}");
                }
            }
        }
    }
}
