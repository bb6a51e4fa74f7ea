// Number plates: every vehicle has three digits of its own, in a font of three by five squares like that of the letters
// beside them.

// Inked squares of each digit, a bit each: by rows from the top, the left one first.
const DIGIT_SQUARES = array<u32, 10>(
    0x7b6fu, 0x749au, 0x73e7u, 0x79a7u, 0x49edu,
    0x79cfu, 0x7bcfu, 0x2527u, 0x7befu, 0x79efu,
);
const DIGIT_COLUMNS: i32 = 3;
const DIGIT_ROWS: i32 = 5;

// Plate and ink in linear light.
const PLATE: vec3<f32> = vec3<f32>(0.761, 0.761, 0.716);
const INK: vec3<f32> = vec3<f32>(0.004, 0.004, 0.004);

// Share of ink in the mean of all digits, and squares a pixel between which they become it.
const MEAN_INK: f32 = 0.57;
const DIGITS_FADE: vec2<f32> = vec2<f32>(1.2, 2.4);

// Three digits without leading zeros. Below 900 no two vehicles share a number: 389 and 900 have no common divisor.
fn registration_number(seed: u32) -> u32 {
    return 100u + (seed * 389u + 223u) % 900u;
}

// 1 on ink, 0 on the plate. Squares count to the right and upwards; between two digits is one without ink.
fn ink_at(square: vec2<f32>, number: u32) -> f32 {
    let column = i32(floor(square.x));
    let row = DIGIT_ROWS - 1 - i32(floor(square.y));
    let place = column / (DIGIT_COLUMNS + 1);
    let across = column % (DIGIT_COLUMNS + 1);
    if column < 0 || place > 2 || across >= DIGIT_COLUMNS || row < 0 || row >= DIGIT_ROWS {
        return 0.0;
    }
    var digits = vec3<u32>(number / 100u, number / 10u % 10u, number % 10u);
    var squares = DIGIT_SQUARES;
    return f32((squares[digits[place]] >> u32(row * DIGIT_COLUMNS + across)) & 1u);
}

// Albedo of a plate where its digits are. `square_dx`: how far the next pixels to the right and below are, in squares.
fn number_on_plate(square: vec2<f32>, square_dx: vec4<f32>, number: u32) -> vec3<f32> {
    var ink = 0.0;
    for (var k = 0; k < 16; k++) {
        let off = (vec2<f32>(f32(k % 4), f32(k / 4)) + 0.5) / 4.0 - 0.5;
        ink += ink_at(square + square_dx.xy * off.x + square_dx.zw * off.y, number) / 16.0;
    }
    let squares = max(length(square_dx.xy), length(square_dx.zw));
    return mix(PLATE, INK, mix(ink, MEAN_INK, smoothstep(DIGITS_FADE.x, DIGITS_FADE.y, squares)));
}
