//! The widest vector instructions of the machine, chosen at run time.
//!
//! Results do not depend on the choice: the sums and products are the same in the same order, and nothing is fused.

/// Returns the integer part of a number from 0 to 2^22, in arithmetic that vectorises; `as` does not.
#[inline(always)]
pub(crate) fn integer_part(number: f32) -> u32 {
    const ROUNDING_OFFSET: f32 = 8_388_608.0; // 2^23: adding it rounds to a whole number, left in the low bits.
    let rounded = number + ROUNDING_OFFSET;
    let above = u32::from(rounded - ROUNDING_OFFSET > number);
    rounded.to_bits().wrapping_sub(ROUNDING_OFFSET.to_bits() + above)
}

/// Transposes rows of `width` values each.
#[inline(always)]
pub(crate) fn transpose(from: &[f32], to: &mut [f32], width: usize, height: usize) {
    const TILE_SIZE: usize = 8;
    let (columns, rows) = (width / TILE_SIZE * TILE_SIZE, height / TILE_SIZE * TILE_SIZE);
    for top in (0..rows).step_by(TILE_SIZE) {
        for left in (0..columns).step_by(TILE_SIZE) {
            let mut tile = [[0.0; TILE_SIZE]; TILE_SIZE];
            for (row, line) in tile.iter_mut().enumerate() {
                line.copy_from_slice(&from[(top + row) * width + left..][..TILE_SIZE]);
            }
            for column in 0..TILE_SIZE {
                let line: [f32; TILE_SIZE] = std::array::from_fn(|row| tile[row][column]);
                to[(left + column) * height + top..][..TILE_SIZE].copy_from_slice(&line);
            }
        }
    }
    for row in 0..height {
        for column in if row < rows { columns } else { 0 }..width {
            to[column * height + row] = from[row * width + column];
        }
    }
}

/// Runs `work` compiled for AVX-512 or AVX2 if the machine supports it. Only code inlined into `work` benefits.
#[cfg(target_arch = "x86_64")]
#[inline]
pub(crate) fn widest<R>(work: impl FnOnce() -> R) -> R {
    use pulp::x86::{V3, V4};
    match (V4::try_new(), V3::try_new()) {
        (Some(simd), _) => simd.vectorize(work),
        (None, Some(simd)) => simd.vectorize(work),
        (None, None) => work(),
    }
}

/// Runs `work` as it is.
#[cfg(not(target_arch = "x86_64"))]
#[inline]
pub(crate) fn widest<R>(work: impl FnOnce() -> R) -> R {
    work()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_whole_part_is_that_of_the_standard_library() {
        for at in 0..=1024 * 64 {
            let number = at as f32 / 64.0;
            for near in [number, number.next_up(), number.next_down().max(0.0)] {
                assert_eq!(integer_part(near), near as u32, "{near}");
            }
        }
    }

    #[test]
    fn a_transposed_grid_has_its_columns_as_rows() {
        for (width, height) in [(1, 1), (8, 16), (21, 13), (3, 40)] {
            let from: Vec<f32> = (0..width * height).map(|at| at as f32).collect();
            let mut to = vec![-1.0; from.len()];
            transpose(&from, &mut to, width, height);
            let expected = (0..width).flat_map(|column| (0..height).map(move |row| (row * width + column) as f32));
            assert!(to.iter().copied().eq(expected), "{width} x {height}");
        }
    }
}
