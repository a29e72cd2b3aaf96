//! CDR in the version of ROS 2 (XCDR1, plain types).
//!
//! A message begins with a header of four bytes that names the byte order. After it every number is aligned to its
//! size, counted from the end of the header. A string has its length with the terminating zero, a sequence the number
//! of its elements.

/// Bytes of the header.
pub const HEADER_SIZE: usize = 4;
/// Header of little-endian CDR.
const LITTLE_ENDIAN_HEADER: [u8; HEADER_SIZE] = [0, 1, 0, 0];

/// Error of a message that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// The message ends within a field.
    #[error("byte {at}: found {found} bytes left, expected {expected}")]
    End {
        /// Position after the header, bytes.
        at: usize,
        /// Bytes that are left.
        found: usize,
        /// Bytes that the field takes.
        expected: usize,
    },
    /// The header names an encoding other than plain CDR.
    #[error("header: found encoding {found:#06x}, expected 0x0000 or 0x0001, plain CDR")]
    Encoding {
        /// Identifier of the encoding.
        found: u16,
    },
    /// A string is not UTF-8, or does not end with a zero.
    #[error("byte {at}: found a string that is not UTF-8 with a terminating zero")]
    Text {
        /// Position of the string after the header, bytes.
        at: usize,
    },
    /// A field has a value that the message does not allow.
    #[error("{field}: found {found}, expected {expected}")]
    Field {
        /// Name of the field.
        field: &'static str,
        /// Value found.
        found: String,
        /// Permitted value.
        expected: String,
    },
}

/// Order of a number's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ByteOrder {
    /// Least significant byte first.
    Little,
    /// Most significant byte first.
    Big,
}

/// A message being written, little-endian, with its header.
#[derive(Debug, Clone)]
pub struct CdrWriter(Vec<u8>);

impl Default for CdrWriter {
    fn default() -> Self {
        Self(LITTLE_ENDIAN_HEADER.to_vec())
    }
}

impl CdrWriter {
    /// Returns the message with its header.
    pub fn finish(self) -> Vec<u8> {
        self.0
    }

    fn align(&mut self, size: usize) {
        let length = (self.0.len() - HEADER_SIZE).next_multiple_of(size) + HEADER_SIZE;
        self.0.resize(length, 0);
    }

    /// Appends a byte.
    pub fn u8(&mut self, value: u8) -> &mut Self {
        self.0.push(value);
        self
    }

    /// Appends a 32-bit number.
    pub fn u32(&mut self, value: u32) -> &mut Self {
        self.align(4);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// Appends a 64-bit floating-point number.
    pub fn f64(&mut self, value: f64) -> &mut Self {
        self.align(8);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// Appends a string.
    pub fn string(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
        self
    }

    /// Appends a sequence of strings.
    pub fn strings(&mut self, all: &[String]) -> &mut Self {
        self.u32(all.len() as u32);
        for text in all {
            self.string(text);
        }
        self
    }

    /// Appends a fixed-size array of floating-point numbers.
    pub fn array(&mut self, all: &[f64]) -> &mut Self {
        for value in all {
            self.f64(*value);
        }
        self
    }

    /// Appends a sequence of floating-point numbers.
    pub fn numbers(&mut self, all: &[f64]) -> &mut Self {
        self.u32(all.len() as u32).array(all)
    }

    /// Appends a sequence of bytes.
    pub fn bytes(&mut self, all: &[u8]) -> &mut Self {
        self.u32(all.len() as u32);
        self.0.extend(all);
        self
    }
}

/// A message being read.
#[derive(Debug, Clone)]
pub struct CdrReader<'a> {
    body: &'a [u8],
    at: usize,
    order: ByteOrder,
}

impl<'a> CdrReader<'a> {
    /// Reads a message with its header.
    ///
    /// # Errors
    /// [`CdrError`] for a header of another encoding.
    pub fn new(message: &'a [u8]) -> Result<Self, CdrError> {
        let Some((header, body)) = message.split_first_chunk::<HEADER_SIZE>() else {
            return Err(CdrError::End { at: 0, found: message.len(), expected: HEADER_SIZE });
        };
        match u16::from_be_bytes([header[0], header[1]]) {
            0 => Ok(Self::from_body(body, ByteOrder::Big)),
            1 => Ok(Self::from_body(body, ByteOrder::Little)),
            found => Err(CdrError::Encoding { found }),
        }
    }

    /// Reads a message without its header.
    pub fn from_body(body: &'a [u8], order: ByteOrder) -> Self {
        Self { body, at: 0, order }
    }

    fn take(&mut self, size: usize) -> Result<&'a [u8], CdrError> {
        let left = self.body.get(self.at..).unwrap_or_default();
        let Some(taken) = left.get(..size) else {
            return Err(CdrError::End { at: self.at, found: left.len(), expected: size });
        };
        self.at += size;
        Ok(taken)
    }

    fn number<const SIZE: usize>(&mut self) -> Result<[u8; SIZE], CdrError> {
        self.at = self.at.next_multiple_of(SIZE);
        let mut bytes = [0; SIZE];
        bytes.copy_from_slice(self.take(SIZE)?);
        if self.order == ByteOrder::Big {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// Reads a byte.
    ///
    /// # Errors
    /// [`CdrError`] if the message ends here.
    pub fn u8(&mut self) -> Result<u8, CdrError> {
        Ok(self.take(1)?[0])
    }

    /// Reads a 32-bit number.
    ///
    /// # Errors
    /// [`CdrError`] if the message ends here.
    pub fn u32(&mut self) -> Result<u32, CdrError> {
        Ok(u32::from_le_bytes(self.number()?))
    }

    /// Reads a 64-bit floating-point number.
    ///
    /// # Errors
    /// [`CdrError`] if the message ends here.
    pub fn f64(&mut self) -> Result<f64, CdrError> {
        Ok(f64::from_le_bytes(self.number()?))
    }

    /// Reads the number of elements of a sequence, each of which takes at least `least` bytes.
    ///
    /// # Errors
    /// [`CdrError`] if the message is too short for them: nothing is allocated for elements that cannot be there.
    pub fn length(&mut self, least: usize) -> Result<usize, CdrError> {
        let count = self.u32()? as usize;
        let (found, expected) = (self.body.len().saturating_sub(self.at), count.saturating_mul(least));
        if expected > found {
            return Err(CdrError::End { at: self.at, found, expected });
        }
        Ok(count)
    }

    /// Reads a string.
    ///
    /// # Errors
    /// [`CdrError`] if the message ends here, or if the text is not UTF-8 with a terminating zero.
    pub fn string(&mut self) -> Result<String, CdrError> {
        let length = self.length(1)?;
        let at = self.at;
        // Some implementations write an empty string without its terminating zero.
        if length == 0 {
            return Ok(String::new());
        }
        let text = self.take(length)?.strip_suffix(&[0]).ok_or(CdrError::Text { at })?;
        String::from_utf8(text.to_vec()).map_err(|_| CdrError::Text { at })
    }

    /// Reads a sequence of strings.
    ///
    /// # Errors
    /// As [`Self::string`].
    pub fn strings(&mut self) -> Result<Vec<String>, CdrError> {
        let count = self.length(4)?;
        (0..count).map(|_| self.string()).collect()
    }

    /// Reads a fixed-size array of floating-point numbers.
    ///
    /// # Errors
    /// [`CdrError`] if the message ends here.
    pub fn array<const SIZE: usize>(&mut self) -> Result<[f64; SIZE], CdrError> {
        let mut all = [0.0; SIZE];
        for value in &mut all {
            *value = self.f64()?;
        }
        Ok(all)
    }

    /// Reads a sequence of floating-point numbers.
    ///
    /// # Errors
    /// [`CdrError`] if the message ends here.
    pub fn numbers(&mut self) -> Result<Vec<f64>, CdrError> {
        let count = self.length(8)?;
        (0..count).map(|_| self.f64()).collect()
    }

    /// Reads a sequence of bytes.
    ///
    /// # Errors
    /// [`CdrError`] if the message ends here.
    pub fn bytes(&mut self) -> Result<&'a [u8], CdrError> {
        let count = self.length(1)?;
        self.take(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_are_aligned_and_of_either_byte_order() {
        let mut cdr = CdrWriter::default();
        cdr.u8(7).u32(0x0102_0304).f64(1.5);
        let little = cdr.finish();
        assert_eq!(little[..12], [0, 1, 0, 0, 7, 0, 0, 0, 4, 3, 2, 1]);
        let mut big = vec![0, 0, 0, 0, 7, 0, 0, 0, 1, 2, 3, 4];
        big.extend(1.5_f64.to_be_bytes());
        for message in [little, big] {
            let mut read = CdrReader::new(&message).expect("plain CDR");
            assert_eq!((read.u8(), read.u32(), read.f64()), (Ok(7), Ok(0x0102_0304), Ok(1.5)));
            assert_eq!(read.u8(), Err(CdrError::End { at: 16, found: 0, expected: 1 }));
        }
    }

    #[test]
    fn other_encodings_and_texts_are_refused() {
        assert_eq!(CdrReader::new(&[0, 7, 0, 0]).err(), Some(CdrError::Encoding { found: 7 }));
        assert_eq!(CdrReader::new(&[0, 1]).err(), Some(CdrError::End { at: 0, found: 2, expected: 4 }));
        let text = |bytes: &[u8]| CdrReader::from_body(bytes, ByteOrder::Little).string();
        assert_eq!(text(&[2, 0, 0, 0, b'a', 0]).as_deref(), Ok("a"));
        assert_eq!(text(&[1, 0, 0, 0, b'a']), Err(CdrError::Text { at: 4 }));
        assert_eq!(text(&[2, 0, 0, 0, 0xff, 0]), Err(CdrError::Text { at: 4 }));
        // A length beyond the message allocates nothing.
        assert_eq!(text(&[255, 255, 255, 255]), Err(CdrError::End { at: 4, found: 0, expected: u32::MAX as usize }));
    }

    proptest! {
        /// No bytes make the reader panic.
        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..64), big in any::<bool>()) {
            let order = if big { ByteOrder::Big } else { ByteOrder::Little };
            let mut read = CdrReader::from_body(&bytes, order);
            let _ = read.strings();
            let _ = read.numbers();
            let _ = read.bytes();
            let _ = read.array::<3>();
        }
    }
}
