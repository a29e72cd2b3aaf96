//! The CRC-16 of Protocol 2.0: polynomial x^16 + x^15 + x^2 + 1, initial value 0, no reflection.
//!
//! It detects every error burst of up to 16 bits, and therefore any single changed byte.

const POLYNOMIAL: u16 = 0x8005;

const TABLE: [u16; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut remainder = (byte as u16) << 8;
        let mut bit = 0;
        while bit < 8 {
            remainder = if remainder & 0x8000 != 0 { (remainder << 1) ^ POLYNOMIAL } else { remainder << 1 };
            bit += 1;
        }
        table[byte] = remainder;
        byte += 1;
    }
    table
};

/// Computes the CRC of `bytes`.
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc, byte| (crc << 8) ^ TABLE[usize::from((crc >> 8) as u8 ^ byte)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Check value of this CRC in the catalogue (there called CRC-16/UMTS).
    #[test]
    fn check_value() {
        assert_eq!(crc16(b"123456789"), 0xFEE8);
    }

    /// First and last entries of the manufacturer's table.
    #[test]
    fn table() {
        assert_eq!(TABLE[..4], [0x0000, 0x8005, 0x800F, 0x000A]);
        assert_eq!(TABLE[255], 0x0202);
    }
}
