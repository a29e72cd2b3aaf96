//! Byte stuffing: on the wire, an extra `FD` follows every `FF FF FD` inside a packet.

const PATTERN: [u8; 3] = [0xFF, 0xFF, 0xFD];
const STUFFING_BYTE: u8 = 0xFD;

/// Returns the stuffed bytes of `plain`.
pub fn stuff(plain: &[u8]) -> Vec<u8> {
    let mut wire = Vec::with_capacity(plain.len() + 2);
    for (n, byte) in plain.iter().enumerate() {
        wire.push(*byte);
        if plain[..=n].ends_with(&PATTERN) {
            wire.push(STUFFING_BYTE);
        }
    }
    wire
}

/// Removes the stuffing from `wire`; `None` if an extra byte is missing, which no sender leaves out.
pub fn unstuff(wire: &[u8]) -> Option<Vec<u8>> {
    let mut plain = Vec::with_capacity(wire.len());
    let mut bytes = wire.iter();
    while let Some(byte) = bytes.next() {
        plain.push(*byte);
        if plain.ends_with(&PATTERN) && bytes.next() != Some(&STUFFING_BYTE) {
            return None;
        }
    }
    Some(plain)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bytes in which the pattern and its neighbours are common.
    pub(crate) fn bytes(longest: usize) -> impl Strategy<Value = Vec<u8>> {
        prop::collection::vec(
            prop_oneof![4 => Just(0xFF), 3 => Just(0xFD), 1 => Just(0), 2 => any::<u8>()],
            0..=longest,
        )
    }

    #[test]
    fn one_pattern() {
        assert_eq!(stuff(&[1, 0xFF, 0xFF, 0xFD, 2]), [1, 0xFF, 0xFF, 0xFD, 0xFD, 2]);
        assert_eq!(stuff(&[0xFF, 0xFF, 0xFD, 0xFD]), [0xFF, 0xFF, 0xFD, 0xFD, 0xFD]);
        assert_eq!(stuff(&[0xFF, 0xFF, 0xFF, 0xFD]), [0xFF, 0xFF, 0xFF, 0xFD, 0xFD]);
    }

    #[test]
    fn missing_extra_byte() {
        assert_eq!(unstuff(&[0xFF, 0xFF, 0xFD]), None);
        assert_eq!(unstuff(&[0xFF, 0xFF, 0xFD, 0]), None);
    }

    proptest! {
        #[test]
        fn round_trip(plain in bytes(60)) {
            let wire = stuff(&plain);
            prop_assert!(!wire.windows(4).any(|four| four == [0xFF, 0xFF, 0xFD, 0]), "a header inside a packet");
            prop_assert_eq!(unstuff(&wire), Some(plain));
        }
    }
}
