//! JPEG encoder for browsers: baseline, colour at half resolution (4:2:0), standard Huffman codes. Source: ITU-T
//! T.81.
//!
//! A browser page receives each frame as a JPEG, so encoding must take a small part of a frame's time. At 640×480,
//! this encoder takes about a third of the time of the `image` crate's, on one thread, without unsafe code.

mod tables;

use self::tables::{AC, DC, DIVISORS, Symbols, ZIGZAG};

/// Pixels per side of a minimum coded unit: four blocks of luminance, one of each chrominance.
const UNIT: usize = 16;

/// Greatest number of pixels per side in the file format.
const MAX_SIDE: u32 = 65_535;

/// Encodes an sRGB image, 3 bytes per pixel, tightly packed, row 0 at the top. `quality` is 1 (smallest) to 100
/// (best), like libjpeg's; values outside this range are clamped.
///
/// Takes milliseconds: call it off async threads.
///
/// Returns `None` if a side is 0 or above 65,535, or if `rgb` does not have that many pixels.
pub fn encode(rgb: &[u8], width: u32, height: u32, quality: u8) -> Option<Vec<u8>> {
    if ![width, height].iter().all(|side| (1..=MAX_SIDE).contains(side)) {
        return None;
    }
    let (columns, rows) = (width as usize, height as usize);
    if rgb.len() != columns.checked_mul(rows)?.checked_mul(3)? {
        return None;
    }
    let divisors = DIVISORS.map(|table| scaled(&table, quality));
    let quantisers = divisors.each_ref().map(Quantiser::new);
    let codes = [0, 1].map(|kind| [Code::new(&DC[kind]), Code::new(&AC[kind])]);

    let mut bits = Bits { out: Vec::with_capacity(rgb.len() / 8), ..Bits::default() };
    head(&mut bits.out, width, height, &divisors);
    let mut band = Band::new(columns);
    // Mean value of the previous block of each component.
    let mut before = [0; 3];
    for top in (0..rows).step_by(UNIT) {
        band.fill(&rgb[top * columns * 3..], columns);
        for left in (0..columns).step_by(UNIT) {
            for (x, y) in [(0, 0), (8, 0), (0, 8), (8, 8)] {
                let block = quantisers[0].quantise(band.luminance(left + x, y));
                bits.block(&block, &mut before[0], &codes[0]);
            }
            for (component, before) in (1..3).zip(&mut before[1..]) {
                let block = quantisers[1].quantise(band.chrominance(component, left));
                bits.block(&block, before, &codes[1]);
            }
        }
    }
    Some(bits.finish())
}

/// Quantisation divisors at a quality, by libjpeg's rule.
fn scaled(table: &[u16; 64], quality: u8) -> [u8; 64] {
    let quality = u32::from(quality.clamp(1, 100));
    let percent = if quality < 50 { 5000 / quality } else { 200 - 2 * quality };
    table.map(|divisor| ((u32::from(divisor) * percent + 50) / 100).clamp(1, 255) as u8)
}

/// The file's header: everything before the coefficients.
fn head(out: &mut Vec<u8>, width: u32, height: u32, divisors: &[[u8; 64]; 2]) {
    out.extend([0xff, 0xd8]);
    let mut segment = |marker: u8, body: &[u8]| {
        out.extend([0xff, marker]);
        out.extend((body.len() as u16 + 2).to_be_bytes());
        out.extend(body);
    };
    // JFIF 1.1, square pixels.
    segment(0xe0, b"JFIF\0\x01\x01\0\0\x01\0\x01\0\0");
    for (table, divisors) in (0..).zip(divisors) {
        let mut body = vec![table];
        body.extend(ZIGZAG.map(|at| divisors[usize::from(at)]));
        segment(0xdb, &body);
    }
    let [[w1, w0], [h1, h0]] = [width, height].map(|side| (side as u16).to_be_bytes());
    // 8 bits per value; three components, each with its number, sampling factors and quantisation table.
    segment(0xc0, &[8, h1, h0, w1, w0, 3, 1, 0x22, 0, 2, 0x11, 1, 3, 0x11, 1]);
    for (class, kinds) in [(0x00, &DC), (0x10, &AC)] {
        for (table, symbols) in (class..).zip(kinds) {
            let mut body = vec![table];
            body.extend(symbols.lengths);
            body.extend(symbols.values);
            segment(0xc4, &body);
        }
    }
    // Components with their Huffman codes; the whole spectrum in one scan.
    segment(0xda, &[3, 1, 0x00, 2, 0x11, 3, 0x11, 0, 63, 0]);
}

/// Eight rows of eight values.
type Block = [[f32; 8]; 8];

/// Sixteen rows of the image: luminance minus 128, and two chrominances around 0.
struct Band {
    planes: [Vec<f32>; 3],
    /// Columns, including those that pad the last unit.
    stride: usize,
}

impl Band {
    fn new(columns: usize) -> Self {
        let stride = columns.next_multiple_of(UNIT);
        Self { planes: [0; 3].map(|_| vec![0.0; stride * UNIT]), stride }
    }

    /// Converts the first rows of `rgb`. Beyond the image's edges, repeats its last column and row.
    fn fill(&mut self, rgb: &[u8], columns: usize) {
        let stride = self.stride;
        let [luma, blue, red] = &mut self.planes;
        let mut filled = 0;
        for row in rgb.chunks_exact(columns * 3).take(UNIT) {
            let span = filled * stride..(filled + 1) * stride;
            let [luma, blue, red] = [&mut luma[span.clone()], &mut blue[span.clone()], &mut red[span]];
            for (((pixel, luma), blue), red) in
                row.chunks_exact(3).zip(&mut *luma).zip(&mut *blue).zip(&mut *red)
            {
                let [r, g, b] = [0, 1, 2].map(|channel| f32::from(pixel[channel]));
                // BT.601, full range, as in JFIF.
                let y = 0.299 * r + 0.587 * g + 0.114 * b;
                *luma = y - 128.0;
                *blue = (b - y) * (0.5 / 0.886);
                *red = (r - y) * (0.5 / 0.701);
            }
            for plane in [luma, blue, red] {
                let last = plane[columns - 1];
                plane[columns..].fill(last);
            }
            filled += 1;
        }
        for plane in &mut self.planes {
            for row in filled..UNIT {
                plane.copy_within((filled - 1) * stride..filled * stride, row * stride);
            }
        }
    }

    fn luminance(&self, x: usize, y: usize) -> Block {
        let mut block = [[0.0; 8]; 8];
        for (row, values) in block.iter_mut().enumerate() {
            let at = (y + row) * self.stride + x;
            values.copy_from_slice(&self.planes[0][at..at + 8]);
        }
        block
    }

    /// Means of 2 × 2 pixels.
    fn chrominance(&self, component: usize, x: usize) -> Block {
        let plane = &self.planes[component];
        let mut block = [[0.0; 8]; 8];
        for (row, values) in block.iter_mut().enumerate() {
            let at = 2 * row * self.stride + x;
            let (upper, lower) = (&plane[at..at + UNIT], &plane[at + self.stride..at + self.stride + UNIT]);
            for (value, (upper, lower)) in
                values.iter_mut().zip(upper.chunks_exact(2).zip(lower.chunks_exact(2)))
            {
                *value = 0.25 * (upper[0] + upper[1] + lower[0] + lower[1]);
            }
        }
        block
    }
}

/// Transforms blocks of pixels into quantised coefficients.
struct Quantiser {
    /// Factors on coefficients: the inverse divisors, times the factors that the fast transform omits.
    factors: Block,
}

impl Quantiser {
    fn new(divisors: &[u8; 64]) -> Self {
        // Arai, Agui and Nakajima 1988: √2 cos(k π / 16), and 1 for k = 0.
        let left_out = |k: usize| match k {
            0 => 1.0,
            _ => std::f64::consts::SQRT_2 * (k as f64 * std::f64::consts::PI / 16.0).cos(),
        };
        let mut factors = [[0.0; 8]; 8];
        for (at, &divisor) in divisors.iter().enumerate() {
            let (row, column) = (at / 8, at % 8);
            // The transform's result is transposed.
            factors[column][row] =
                (1.0 / (8.0 * f64::from(divisor) * left_out(row) * left_out(column))) as f32;
        }
        Self { factors }
    }

    /// Quantised coefficients in column order.
    fn quantise(&self, mut block: Block) -> [i32; 64] {
        transform(&mut block);
        block = transposed(&block);
        transform(&mut block);
        let mut quantised = [0; 64];
        let values = block.as_flattened().iter().zip(self.factors.as_flattened());
        for (quantised, (value, factor)) in quantised.iter_mut().zip(values) {
            // Adding 1.5 · 2²³ rounds to the nearest integer, which is then in the low bits.
            const ROUND: f32 = 12_582_912.0;
            *quantised = (value * factor + ROUND).to_bits() as i32 - ROUND.to_bits() as i32;
        }
        quantised
    }
}

fn transposed(block: &Block) -> Block {
    let mut turned = [[0.0; 8]; 8];
    for (row, values) in block.iter().enumerate() {
        for (column, value) in values.iter().enumerate() {
            turned[column][row] = *value;
        }
    }
    turned
}

/// Cosine transforms of all columns, with the five multiplications of Arai, Agui and Nakajima 1988. The results lack
/// constant factors.
#[allow(clippy::needless_range_loop, reason = "a column crosses all rows")]
fn transform(block: &mut Block) {
    for column in 0..8 {
        let at = |row: usize| block[row][column];
        let (sum, difference) = (|i: usize| at(i) + at(7 - i), |i: usize| at(i) - at(7 - i));
        let ([s0, s1, s2, s3], [d0, d1, d2, d3]) =
            ([sum(0), sum(1), sum(2), sum(3)], [difference(0), difference(1), difference(2), difference(3)]);

        let (e0, e1, e2, e3) = (s0 + s3, s1 + s2, s1 - s2, s0 - s3);
        let turn = (e2 + e3) * std::f32::consts::FRAC_1_SQRT_2;

        let (o0, o1, o2) = (d3 + d2, d2 + d1, d1 + d0);
        // Constants of the rotation by 3 π / 8.
        let shared = (o0 - o2) * 0.382_683_43;
        let (low, high) = (0.541_196_1 * o0 + shared, 1.306_563 * o2 + shared);
        let middle = o1 * std::f32::consts::FRAC_1_SQRT_2;
        let (plus, minus) = (d0 + middle, d0 - middle);

        block[0][column] = e0 + e1;
        block[4][column] = e0 - e1;
        block[2][column] = e3 + turn;
        block[6][column] = e3 - turn;
        block[5][column] = minus + low;
        block[3][column] = minus - low;
        block[1][column] = plus + high;
        block[7][column] = plus - high;
    }
}

/// Huffman codes and their lengths, by symbol.
struct Code([(u32, u32); 256]);

impl Code {
    fn new(symbols: &Symbols) -> Self {
        let mut codes = [(0, 0); 256];
        let (mut values, mut code) = (symbols.values.iter(), 0);
        for (length, &count) in (1..).zip(&symbols.lengths) {
            for &value in values.by_ref().take(usize::from(count)) {
                codes[usize::from(value)] = (code, length);
                code += 1;
            }
            code <<= 1;
        }
        Self(codes)
    }
}

/// A writer of bits.
#[derive(Default)]
struct Bits {
    out: Vec<u8>,
    /// Bits that are not in `out` yet, in the lowest positions.
    pending: u64,
    /// Number of these bits, below 32.
    held: u32,
}

impl Bits {
    /// Appends at most 32 bits. Higher bits of `bits` must be 0.
    fn put(&mut self, bits: u32, length: u32) {
        self.pending = self.pending << length | u64::from(bits);
        self.held += length;
        if self.held >= 32 {
            self.held -= 32;
            let word = (self.pending >> self.held) as u32;
            // A byte of ones is followed by a zero byte. Only a byte whose highest bit is set can be such a byte.
            if word & 0x8080_8080 & !word.wrapping_add(0x0101_0101) == 0 {
                self.out.extend(word.to_be_bytes());
            } else {
                word.to_be_bytes().into_iter().for_each(|byte| self.byte(byte));
            }
        }
    }

    fn byte(&mut self, byte: u8) {
        self.out.push(byte);
        if byte == 0xff {
            self.out.push(0);
        }
    }

    /// Appends the code of a symbol, and a value. The symbol's low four bits are the value's length.
    fn symbol(&mut self, code: &Code, run: u32, value: i32) {
        let length = 32 - value.unsigned_abs().leading_zeros();
        // A negative value is stored minus one.
        let value = (value + (value >> 31)) as u32 & ((1 << length) - 1);
        let (bits, bits_length) = code.0[(run << 4 | length) as usize];
        self.put(bits << length | value, bits_length + length);
    }

    fn block(&mut self, block: &[i32; 64], before: &mut i32, [dc, ac]: &[Code; 2]) {
        let mean = block[0].clamp(-1024, 1023);
        self.symbol(dc, 0, mean - *before);
        *before = mean;
        let (mut ordered, mut there) = ([0; 64], 0_u64);
        for (i, at) in ZIGZAG.into_iter().enumerate().skip(1) {
            // Blocks are in column order.
            let value = block[usize::from(at % 8 * 8 + at / 8)];
            ordered[i] = value;
            there |= u64::from(value != 0) << i;
        }
        let mut last = 0;
        while there != 0 {
            let at = there.trailing_zeros();
            there &= there - 1;
            let mut run = at - last - 1;
            last = at;
            while run > 15 {
                let (bits, length) = ac.0[0xf0];
                self.put(bits, length);
                run -= 16;
            }
            self.symbol(ac, run, ordered[at as usize].clamp(-1023, 1023));
        }
        if last < 63 {
            let (bits, length) = ac.0[0];
            self.put(bits, length);
        }
    }

    /// Pads the last byte with ones, and ends the file.
    fn finish(mut self) -> Vec<u8> {
        let fill = (8 - self.held % 8) % 8;
        let rest = self.pending << fill | ((1 << fill) - 1);
        for at in (0..(self.held + fill) / 8).rev() {
            self.byte((rest >> (8 * at)) as u8);
        }
        self.out.extend([0xff, 0xd9]);
        self.out
    }
}

#[cfg(test)]
mod tests;
