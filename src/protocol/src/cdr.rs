//! CDR serialization (OMG Common Data Representation, plain, little-endian): the encoding of ROS 2 messages.

/// Serializes one message. Each primitive is aligned to its size, counted from the end of the four-byte encapsulation
/// header.
#[derive(Clone, Debug)]
pub struct CdrWriter {
    bytes: Vec<u8>,
    /// Index of the first byte after the header.
    start: usize,
}

const HEADER: [u8; 4] = [0, 1, 0, 0];

impl CdrWriter {
    /// Begins a message in a buffer whose old content is dropped.
    pub fn reusing(mut bytes: Vec<u8>) -> Self {
        bytes.clear();
        Self::behind(bytes)
    }

    /// Begins a message behind what a buffer holds.
    pub fn behind(mut bytes: Vec<u8>) -> Self {
        bytes.extend_from_slice(&HEADER);
        Self { start: bytes.len(), bytes }
    }

    /// The whole buffer, with the message at its end.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    fn align(&mut self, size: usize) {
        let padded = (self.bytes.len() - self.start).next_multiple_of(size);
        self.bytes.resize(self.start + padded, 0);
    }

    /// Appends one byte.
    pub fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    /// Appends four bytes, aligned to 4.
    pub fn u32(&mut self, value: u32) {
        self.align(4);
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    /// Appends eight bytes, aligned to 8.
    pub fn u64(&mut self, value: u64) {
        self.align(8);
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    /// Appends a single-precision number, aligned to 4.
    pub fn f32(&mut self, value: f32) {
        self.align(4);
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    /// Appends a double-precision number, aligned to 8.
    pub fn f64(&mut self, value: f64) {
        self.align(8);
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    /// A sequence of numbers: count, then elements.
    pub fn f64s(&mut self, numbers: impl ExactSizeIterator<Item = f64>) {
        let count = numbers.len();
        self.u32(count as u32);
        if count > 0 {
            self.align(8);
        }
        let start = self.bytes.len();
        self.bytes.resize(start + 8 * count, 0);
        let places = self.bytes[start..].chunks_exact_mut(8);
        places.zip(numbers).for_each(|(place, number)| place.copy_from_slice(&number.to_le_bytes()));
    }

    /// A sequence of bytes: length, then bytes.
    pub fn octets(&mut self, octets: &[u8]) {
        self.u32(octets.len() as u32);
        self.bytes.extend_from_slice(octets);
    }

    /// A string: length with the terminating zero, bytes, zero.
    pub fn string(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.push(0);
    }
}

/// Deserializes the primitives of one message in their order; `None` past its end.
#[derive(Clone, Debug)]
pub struct CdrReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> CdrReader<'a> {
    /// Begins after the encapsulation header, which must be that of [`CdrWriter`].
    pub fn new(bytes: &'a [u8]) -> Option<Self> {
        Some(Self::of_body(bytes.strip_prefix(&HEADER)?))
    }

    /// Begins at the first byte behind the encapsulation header.
    pub fn of_body(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let start = self.at.next_multiple_of(N);
        let bytes = self.bytes.get(start..start + N)?.try_into().ok()?;
        self.at = start + N;
        Some(bytes)
    }

    /// Whether nothing is left to read.
    pub fn is_at_end(&self) -> bool {
        self.at >= self.bytes.len()
    }

    /// Reads one byte.
    pub fn u8(&mut self) -> Option<u8> {
        self.take::<1>().map(|[byte]| byte)
    }

    /// Reads four bytes, aligned to 4.
    pub fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    /// Reads eight bytes, aligned to 8.
    pub fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    /// Reads a single-precision number, aligned to 4.
    pub fn f32(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes)
    }

    /// Reads a double-precision number, aligned to 8.
    pub fn f64(&mut self) -> Option<f64> {
        self.take().map(f64::from_le_bytes)
    }

    /// A sequence of numbers: their count, then they.
    pub fn f64s(&mut self) -> Option<Vec<f64>> {
        (0..self.u32()?).map(|_| self.f64()).collect()
    }

    /// A sequence of bytes: their length, then they.
    pub fn octets(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()? as usize;
        let octets = self.bytes.get(self.at..self.at.checked_add(length)?)?;
        self.at += length;
        Some(octets)
    }

    /// A string with its terminating zero; `None` also for bytes that are not UTF-8.
    pub fn string(&mut self) -> Option<String> {
        let octets = self.octets()?;
        String::from_utf8(octets.strip_suffix(&[0])?.to_vec()).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn primitives_are_aligned_after_the_header() {
        let mut cdr = CdrWriter::reusing(vec![9; 40]);
        cdr.u8(7);
        cdr.u32(1);
        cdr.string("ab");
        cdr.f64(1.0);
        let bytes = cdr.into_bytes();
        assert_eq!(bytes[..8], [0, 1, 0, 0, 7, 0, 0, 0]);
        assert_eq!(bytes[8..12], 1_u32.to_le_bytes());
        assert_eq!(bytes[12..19], [3, 0, 0, 0, b'a', b'b', 0]);
        // 15 bytes so far, the double starts at 16.
        assert_eq!(bytes[20..28], 1_f64.to_le_bytes());
        assert_eq!(bytes.len(), 28);
    }

    #[test]
    fn messages_are_aligned_wherever_they_begin() {
        let write = |bytes: Vec<u8>| {
            let mut cdr = CdrWriter::behind(bytes);
            cdr.u8(7);
            cdr.f64s([0.1, 0.2].into_iter());
            cdr.f64s([].into_iter());
            cdr.u8(8);
            cdr.into_bytes()
        };
        let alone = write(Vec::new());
        for before in 1..9 {
            assert_eq!(write(vec![9; before])[before..], alone);
        }
        let mut read = CdrReader::new(&alone).unwrap();
        assert_eq!((read.u8(), read.f64s()), (Some(7), Some(vec![0.1, 0.2])));
        assert_eq!((read.f64s(), read.u8(), read.u8()), (Some(vec![]), Some(8), None));
    }

    #[test]
    fn what_was_written_is_read_and_no_more() {
        let mut cdr = CdrWriter::reusing(Vec::new());
        cdr.u8(7);
        cdr.f64(0.1);
        cdr.u32(9);
        cdr.u64(u64::MAX);
        let bytes = cdr.into_bytes();
        let mut read = CdrReader::new(&bytes).unwrap();
        assert_eq!(
            (read.u8(), read.f64(), read.u32(), read.u64()),
            (Some(7), Some(0.1), Some(9), Some(u64::MAX))
        );
        assert_eq!((read.u8(), read.u64()), (None, None));
        assert!(CdrReader::new(&bytes[1..]).is_none());
    }
}
