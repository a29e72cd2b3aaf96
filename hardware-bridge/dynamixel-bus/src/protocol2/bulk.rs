//! Parameters of the bulk instructions: different registers of each servo in one packet.

use super::error::InstructionError;

/// Read from one servo.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BulkRead {
    /// Id of the servo.
    pub id: u8,
    /// First register.
    pub address: u16,
    /// Number of bytes.
    pub length: u16,
}

/// Write to one servo.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BulkWrite {
    /// Id of the servo.
    pub id: u8,
    /// First register.
    pub address: u16,
    /// Bytes to write.
    pub data: Vec<u8>,
}

/// Encodes the parameters of a bulk read: `id | address (2) | length (2)` for each servo.
pub fn encode_reads(reads: &[BulkRead]) -> Result<Vec<u8>, InstructionError> {
    check_unique_ids(reads.iter().map(|read| read.id))?;
    Ok(reads.iter().flat_map(|read| head(read.id, read.address, read.length)).collect())
}

/// Decodes the parameters of a bulk read; `None` if their number does not fit.
pub fn decode_reads(parameters: &[u8]) -> Result<Option<Vec<BulkRead>>, InstructionError> {
    let (heads, rest) = parameters.as_chunks::<5>();
    let reads: Vec<BulkRead> = heads
        .iter()
        .map(|&[id, a, b, c, d]| BulkRead {
            id,
            address: u16::from_le_bytes([a, b]),
            length: u16::from_le_bytes([c, d]),
        })
        .collect();
    check_unique_ids(reads.iter().map(|read| read.id))?;
    Ok(rest.is_empty().then_some(reads))
}

/// Encodes the parameters of a bulk write: `id | address (2) | length (2) | data` for each servo.
pub fn encode_writes(writes: &[BulkWrite]) -> Result<Vec<u8>, InstructionError> {
    check_unique_ids(writes.iter().map(|write| write.id))?;
    let mut parameters = Vec::new();
    for BulkWrite { id, address, data } in writes {
        let length = u16::try_from(data.len()).map_err(|_| InstructionError::DataLength {
            id: *id,
            found: data.len(),
            expected: u16::MAX.into(),
        })?;
        parameters.extend(head(*id, *address, length));
        parameters.extend_from_slice(data);
    }
    Ok(parameters)
}

/// Decodes the parameters of a bulk write; `None` if their number does not fit.
pub fn decode_writes(mut parameters: &[u8]) -> Result<Option<Vec<BulkWrite>>, InstructionError> {
    let mut writes = Vec::new();
    while let &[id, a, b, c, d, ref rest @ ..] = parameters {
        let Some((data, rest)) = rest.split_at_checked(u16::from_le_bytes([c, d]).into()) else { return Ok(None) };
        writes.push(BulkWrite { id, address: u16::from_le_bytes([a, b]), data: data.to_vec() });
        parameters = rest;
    }
    check_unique_ids(writes.iter().map(|write| write.id))?;
    Ok(parameters.is_empty().then_some(writes))
}

fn head(id: u8, address: u16, length: u16) -> [u8; 5] {
    let ([a, b], [c, d]) = (address.to_le_bytes(), length.to_le_bytes());
    [id, a, b, c, d]
}

/// Checks that each id occurs only once in a packet, as the e-Manual demands.
fn check_unique_ids(ids: impl Iterator<Item = u8>) -> Result<(), InstructionError> {
    let mut seen = [false; 256];
    for id in ids {
        if std::mem::replace(&mut seen[usize::from(id)], true) {
            return Err(InstructionError::Repeated { id });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn uneven_and_repeated() {
        assert_eq!(decode_reads(&[1, 144, 0, 2]), Ok(None));
        assert_eq!(decode_writes(&[1, 32, 0, 2, 0, 160]), Ok(None));
        let read = |id| BulkRead { id, address: 144, length: 2 };
        assert_eq!(encode_reads(&[read(1), read(2), read(1)]), Err(InstructionError::Repeated { id: 1 }));
        assert_eq!(decode_reads(&[1, 0, 0, 1, 0, 1, 2, 0, 1, 0]), Err(InstructionError::Repeated { id: 1 }));
        let huge = BulkWrite { id: 3, address: 0, data: vec![0; 65_536] };
        let expected = InstructionError::DataLength { id: 3, found: 65_536, expected: 65_535 };
        assert_eq!(encode_writes(&[huge]), Err(expected));
    }

    proptest! {
        /// Parameters that can be decoded are the ones that the encoder would have written.
        #[test]
        fn decoded_is_encoded(parameters in prop::collection::vec(any::<u8>(), 0..60)) {
            if let Ok(Some(reads)) = decode_reads(&parameters) {
                prop_assert_eq!(&encode_reads(&reads)?, &parameters);
            }
            if let Ok(Some(writes)) = decode_writes(&parameters) {
                prop_assert_eq!(&encode_writes(&writes)?, &parameters);
            }
        }
    }
}
