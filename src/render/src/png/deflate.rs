//! DEFLATE encoder for filtered rows, as a zlib stream (RFC 1950 and 1951): one dynamic Huffman code from sampled byte
//! frequencies, and run lengths of zeros; no other matches. Encoding takes no branch per byte.

use simd_adler32::Adler32;

/// Symbols of literals, end of block and match lengths.
const SYMBOLS: usize = 286;
const END: usize = 256;
/// Limit of the code length: four codes and up to 7 pending bits fit 64 bits.
const LONGEST_CODE: u32 = 14;
/// Bytes that are encoded together.
const GROUP: usize = 8;
/// Longest match that has a symbol.
const LONGEST_RUN: usize = 258;

/// Symbol frequencies of a sample.
#[derive(Debug)]
pub(super) struct SymbolCounts {
    counts: [u32; SYMBOLS],
}

/// Huffman code: bits of each symbol, the first bit lowest.
#[derive(Debug)]
struct HuffmanCode {
    /// Literals: bits in the lower half, their number in the upper.
    bytes: [u32; 256],
    end: (u64, u32),
    /// Matches at distance 1 by length minus 3: length symbol, extra bits and distance code.
    runs: Vec<(u64, u32)>,
}

/// Streaming encoder.
pub(super) struct DeflateEncoder {
    bytes: Vec<u8>,
    end: BitWriter,
    code: HuffmanCode,
    checksum: Adler32,
}

/// Position in the bit stream, with the bits of the last incomplete byte.
#[derive(Clone, Copy, Debug, Default)]
struct BitWriter {
    at: usize,
    waiting: u64,
    count: u32,
}

impl BitWriter {
    /// Writes `count` bits, at most 56.
    #[inline(always)]
    fn put(&mut self, buffer: &mut [u8], (bits, count): (u64, u32)) {
        self.waiting |= bits << self.count;
        self.count += count;
        buffer[self.at..self.at + 8].copy_from_slice(&self.waiting.to_le_bytes());
        let whole = self.count & !7;
        self.at += whole as usize / 8;
        self.waiting >>= whole;
        self.count &= 7;
    }
}

/// Receiver of literals and runs of zeros.
trait SymbolSink {
    fn group(&mut self, bytes: [u8; GROUP]);
    fn zeros(&mut self, count: usize);
    fn byte(&mut self, byte: u8);
}

fn for_each_symbol(data: &[u8], sink: &mut impl SymbolSink) {
    let (groups, rest) = data.as_chunks::<GROUP>();
    let mut zeros = 0;
    for &group in groups {
        if u64::from_le_bytes(group) == 0 {
            zeros += GROUP;
            continue;
        }
        if zeros > 0 {
            sink.zeros(zeros);
            zeros = 0;
        }
        sink.group(group);
    }
    if zeros > 0 {
        sink.zeros(zeros);
    }
    rest.iter().for_each(|&byte| sink.byte(byte));
}

/// Match lengths that encode a run of zeros after its first byte.
fn repetitions(zeros: usize) -> impl Iterator<Item = usize> {
    let mut left = zeros - 1;
    std::iter::from_fn(move || {
        // Leaves no rest below the minimum match length of 3.
        let length =
            if left > LONGEST_RUN && left < LONGEST_RUN + 3 { left - 3 } else { left.min(LONGEST_RUN) };
        left -= length;
        (length > 0).then_some(length)
    })
}

/// Length symbol, extra bits and their number of a match (RFC 1951, 3.2.5).
fn length_symbol(length: usize) -> (usize, u64, u32) {
    if length == LONGEST_RUN {
        return (285, 0, 0);
    }
    let beyond = length - 3;
    if beyond < 8 {
        return (257 + beyond, 0, 0);
    }
    let extra = beyond.ilog2() - 2;
    (257 + 4 * extra as usize + (beyond >> extra), (beyond & ((1 << extra) - 1)) as u64, extra)
}

impl Default for SymbolCounts {
    fn default() -> Self {
        // Every symbol gets a code.
        Self { counts: [1; SYMBOLS] }
    }
}

impl SymbolCounts {
    /// Counts the symbols of data.
    pub(super) fn add(&mut self, data: &[u8]) {
        for_each_symbol(data, self);
    }

    /// Code length of each symbol; halves the frequencies until none exceeds the limit.
    fn lengths(mut self) -> [u8; SYMBOLS] {
        loop {
            let lengths = huffman(&self.counts);
            if lengths.iter().all(|&length| u32::from(length) <= LONGEST_CODE) {
                return lengths;
            }
            self.counts.iter_mut().for_each(|count| *count = *count / 2 + 1);
        }
    }
}

impl SymbolSink for SymbolCounts {
    fn group(&mut self, bytes: [u8; GROUP]) {
        bytes.into_iter().for_each(|byte| self.byte(byte));
    }

    fn zeros(&mut self, count: usize) {
        self.byte(0);
        repetitions(count).for_each(|length| self.counts[length_symbol(length).0] += 1);
    }

    fn byte(&mut self, byte: u8) {
        self.counts[usize::from(byte)] += 1;
    }
}

/// Code lengths by Huffman's algorithm.
fn huffman(counts: &[u32; SYMBOLS]) -> [u8; SYMBOLS] {
    use std::cmp::Reverse;
    use std::collections::BinaryHeap;
    // Nodes: leaves first, every parent after its children.
    let mut parents = vec![0; 2 * SYMBOLS - 1];
    let mut rarest: BinaryHeap<_> =
        counts.iter().zip(0..).map(|(&count, node)| Reverse((count, node))).collect();
    for parent in SYMBOLS..2 * SYMBOLS - 1 {
        let mut sum = 0;
        for Reverse((count, node)) in [rarest.pop(), rarest.pop()].into_iter().flatten() {
            sum += count;
            parents[node] = parent;
        }
        rarest.push(Reverse((sum, parent)));
    }
    let mut depths = vec![0_u8; 2 * SYMBOLS - 1];
    for node in (0..2 * SYMBOLS - 2).rev() {
        depths[node] = depths[parents[node]] + 1;
    }
    std::array::from_fn(|symbol| depths[symbol])
}

impl HuffmanCode {
    fn new(lengths: &[u8; SYMBOLS]) -> Self {
        // Canonical codes: consecutive within a length, shorter lengths first (RFC 1951, 3.2.2).
        let mut next = 0_u32;
        let mut codes = [(0_u64, 0_u32); SYMBOLS];
        for length in 1..=LONGEST_CODE {
            for (code, _) in codes.iter_mut().zip(lengths).filter(|(_, found)| u32::from(**found) == length) {
                *code = (u64::from(next.reverse_bits() >> (32 - length)), length);
                next += 1;
            }
            next <<= 1;
        }
        let run = |beyond: usize| {
            let (symbol, extra, extra_count) = length_symbol(beyond + 3);
            let (bits, count) = codes[symbol];
            // The only distance code is one bit, 0.
            (bits | extra << count, count + extra_count + 1)
        };
        Self {
            bytes: std::array::from_fn(|byte| codes[byte].0 as u32 | codes[byte].1 << 16),
            end: codes[END],
            runs: (0..=LONGEST_RUN - 3).map(run).collect(),
        }
    }

    fn byte(&self, byte: u8) -> (u64, u32) {
        let entry = self.bytes[usize::from(byte)];
        (u64::from(entry & 0xffff), entry >> 16)
    }

    /// Concatenated codes of four literals.
    #[inline(always)]
    fn four(&self, bytes: [u8; 4]) -> (u64, u32) {
        let [a, b, c, d] = bytes.map(|byte| self.bytes[usize::from(byte)]);
        let bits = |entry: u32| u64::from(entry & 0xffff);
        let (ab, cd) = (a >> 16, c >> 16);
        let first = bits(a) | bits(b) << ab;
        let second = bits(c) | bits(d) << cd;
        let middle = ab + (b >> 16);
        (first | second << middle, middle + cd + (d >> 16))
    }
}

/// Encodes literals and runs with a Huffman code.
struct HuffmanWriter<'a> {
    code: &'a HuffmanCode,
    buffer: &'a mut [u8],
    end: BitWriter,
}

/// Inlined, so that the state stays in registers.
impl SymbolSink for HuffmanWriter<'_> {
    #[inline(always)]
    fn group(&mut self, [a, b, c, d, e, f, g, h]: [u8; GROUP]) {
        self.end.put(self.buffer, self.code.four([a, b, c, d]));
        self.end.put(self.buffer, self.code.four([e, f, g, h]));
    }

    fn zeros(&mut self, count: usize) {
        self.byte(0);
        repetitions(count).for_each(|length| self.end.put(self.buffer, self.code.runs[length - 3]));
    }

    fn byte(&mut self, byte: u8) {
        self.end.put(self.buffer, self.code.byte(byte));
    }
}

impl DeflateEncoder {
    /// Starts a stream in reused memory.
    pub(super) fn new(memory: Vec<u8>, sample: SymbolCounts) -> Self {
        let lengths = sample.lengths();
        let (code, checksum) = (HuffmanCode::new(&lengths), Adler32::new());
        let mut data = Self { bytes: memory, end: BitWriter::default(), code, checksum };
        // zlib header: deflate, 32 KiB window, fastest.
        data.put(0x0178, 16);
        // Final block with a dynamic code: all symbols, one distance code, all 19 code length codes.
        data.put(0b1 | 0b10 << 1 | (SYMBOLS as u64 - 257) << 3 | (19 - 4) << 13, 17);
        // Code lengths take four bits each; the three repeat codes, which come first, are unused.
        data.put(0, 9);
        (0..16).for_each(|_| data.put(4, 3));
        for length in lengths.into_iter().chain([1]) {
            data.put(u64::from(length.reverse_bits() >> 4), 4);
        }
        data
    }

    fn make_room(&mut self, bytes: usize) {
        let needed = self.end.at + bytes + 16;
        if self.bytes.len() < needed {
            self.bytes.resize(needed.max(2 * self.bytes.len()), 0);
        }
    }

    fn put(&mut self, bits: u64, count: u32) {
        self.make_room(0);
        self.end.put(&mut self.bytes, (bits, count));
    }

    /// Appends data to the stream.
    pub(super) fn write(&mut self, data: &[u8]) {
        self.checksum.write(data);
        // No byte takes more bits than the longest code.
        self.make_room(data.len() * LONGEST_CODE as usize / 8);
        let mut writer = HuffmanWriter { code: &self.code, buffer: &mut self.bytes, end: self.end };
        for_each_symbol(data, &mut writer);
        self.end = writer.end;
    }

    /// Ends the stream; returns the memory and the length of the stream in it.
    pub(super) fn finish(mut self) -> (Vec<u8>, usize) {
        let (bits, count) = self.code.end;
        self.put(bits, count);
        self.put(0, (8 - self.end.count) % 8);
        self.put(u64::from(self.checksum.finish().swap_bytes()), 32);
        (self.bytes, self.end.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn deflated(parts: &[&[u8]], sample: &[u8]) -> Vec<u8> {
        let mut counts = SymbolCounts::default();
        counts.add(sample);
        let mut data = DeflateEncoder::new(Vec::new(), counts);
        parts.iter().for_each(|part| data.write(part));
        let (bytes, count) = data.finish();
        bytes[..count].to_vec()
    }

    fn inflated(data: &[u8]) -> Vec<u8> {
        fdeflate::decompress_to_vec(data).expect("a stream of zlib")
    }

    #[test]
    fn runs_of_every_length_come_back() {
        for zeros in 0..1200 {
            let data = [vec![1; 8], vec![0; zeros], vec![7; zeros % 11]].concat();
            assert_eq!(inflated(&deflated(&[&data], &data)), data, "{zeros}");
        }
    }

    #[test]
    fn every_byte_has_a_code_whatever_the_sample_was() {
        let all: Vec<u8> = (0..=255).cycle().take(5000).collect();
        // As uneven as can be: without a limit codes would have 30 bits and more.
        let uneven: Vec<u8> = (0..24_u8).flat_map(|k| vec![k + 1; 1 << k.min(20)]).collect();
        for sample in [&[][..], &[0; 4000], &all, &uneven] {
            assert_eq!(inflated(&deflated(&[&all, &all[..13]], sample)), [&all[..], &all[..13]].concat());
        }
    }

    #[test]
    fn what_the_sample_tells_is_short() {
        let data: Vec<u8> = (0..80_000_u32)
            .map(|k| [255, 0, 1, 0, 2, 254, 1, 0][(k.wrapping_mul(0x9E37_79B1) >> 29) as usize])
            .collect();
        let short = deflated(&[&data], &data).len();
        // Eight values, some more often: three bits each at the most, and 200 bytes to begin with.
        assert!(short < 80_000 * 3 / 8 + 200, "{short}");
    }

    proptest! {
        #[test]
        fn data_come_back(
            parts in prop::collection::vec(
                prop::collection::vec(prop_oneof![3 => Just(0_u8), 1 => any::<u8>(), 1 => 250..=255_u8], 0..2000),
                0..4,
            ),
            sample in prop::collection::vec(any::<u8>(), 0..100),
        ) {
            let parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
            prop_assert_eq!(inflated(&deflated(&parts, &sample)), parts.concat());
        }
    }
}
