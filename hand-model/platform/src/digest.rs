//! SHA-256 in hexadecimal digits. Files refer to each other by it.

use sha2::{Digest as _, Sha256};

/// Returns the SHA-256 of `bytes`, 64 digits.
///
/// ```
/// let digest = ftac_platform::digest::sha256(b"abc");
/// assert!(digest.starts_with("ba7816bf") && digest.len() == 64);
/// ```
pub fn sha256(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

/// Formats `bytes` as hexadecimal text, two digits a byte.
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First example of the test vectors of FIPS 180-4.
    #[test]
    fn a_published_digest() {
        assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
