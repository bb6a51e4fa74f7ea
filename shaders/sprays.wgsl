// Sprays of leaves and boughs of conifers on trees near the camera: what of a rhombus they cover.

// Texture coordinates from which on leaves are on sprays near the camera, each of which has a cell; width of a spray as a
// share of its length. As in trees/near.rs.
const SPRAY_UV: f32 = 1024.0;
const SPRAY_WIDE: f32 = 0.86;
// Leaves of a spray, the last at its tip, and half the width of a leaf as a share of its length.
const SPRAY_LEAVES: i32 = 9;
const LEAF_WIDE: f32 = 0.24;
// Texture coordinate up from which on a spray is the bough of a conifer, and its width as a share of its length. As in
// trees/spruce.rs.
const BOUGH_UV: f32 = 2048.0;
const BOUGH_WIDE: f32 = 0.72;
// Twigs of a bough, half their width with needles, and the length of a pair of needles along them.
const BOUGH_TWIGS: i32 = 17;
const TWIG_WIDE: f32 = 0.046;
const NEEDLE_LONG: f32 = 0.017;
// Sizes of a pixel, in sprays, between which leaves are no longer told apart.
const SPRAY_FADE: vec2<f32> = vec2<f32>(0.05, 0.14);

// The leaves of one spray at a place.
struct SprayLeaf {
    // Factor on the albedo of the crown.
    tone: vec3<f32>,
    tilt: vec2<f32>,
    // Share of the pixel that leaves and stem cover.
    cover: f32,
}

// What is dark inside of a crown near the camera, by its texture coordinates, as in trees/near.rs; a camera so near to it, in
// metres, is in the crown, where it sees leaves alone.
const INSIDE_UV: f32 = 1024.0;
const IN_CROWN_M: vec2<f32> = vec2<f32>(3.5, 5.0);

// How much of what is dark inside of a crown is seen from a distance, metres.
fn inside_cover(uv: vec2<f32>, distance: f32) -> f32 {
    return select(1.0, smoothstep(IN_CROWN_M.x, IN_CROWN_M.y, distance), uv.x < -0.5 * INSIDE_UV);
}

fn is_spray(uv: vec2<f32>) -> bool {
    return uv.x > SPRAY_UV - 1.0;
}

// Size of a pixel, in sprays, by the derivatives of texture coordinates.
fn pixel_in_sprays(uv_dx: vec2<f32>, uv_dy: vec2<f32>) -> f32 {
    return max(sqrt(length(uv_dx) * length(uv_dy)), 1e-5);
}

fn is_bough(uv: vec2<f32>) -> bool {
    return uv.y > BOUGH_UV - 1.0;
}

// What is seen of a spray or a bough. `pixel` is the size of a pixel in sprays.
fn spray_leaf(uv: vec2<f32>, pixel: f32) -> SprayLeaf {
    let cell = vec2<i32>(floor(uv + vec2<f32>(0.5, 0.0)));
    // From the foot of the stem: across and along, as shares.
    let place = uv - vec2<f32>(cell);
    var leaf: SprayLeaf;
    if is_bough(uv) {
        leaf = bough_twig(cell, place * vec2<f32>(BOUGH_WIDE, 1.0), pixel);
    } else {
        leaf = leaf_on_stem(cell, place * vec2<f32>(SPRAY_WIDE, 1.0), pixel);
    }
    // From afar a spray is an oval of leaves.
    let far = smoothstep(SPRAY_FADE.x, SPRAY_FADE.y, pixel);
    let oval = 0.72 * (1.0 - smoothstep(0.7, 1.0, abs(2.0 * place.x) + abs(2.0 * place.y - 1.0)));
    leaf.cover = mix(leaf.cover, oval, far);
    leaf.tone = mix(leaf.tone, vec3<f32>(1.0), far);
    leaf.tilt *= 1.0 - far;
    return leaf;
}

// Twigs with needles in pairs along a bough, and one at its tip.
fn bough_twig(cell: vec2<i32>, at: vec2<f32>, pixel: f32) -> SprayLeaf {
    var twig = SprayLeaf(vec3<f32>(0.5), vec2<f32>(0.0), 0.0);
    let serrated = 1.0 - smoothstep(0.25, 0.6, pixel / NEEDLE_LONG);
    var deepest = -1.0;
    for (var k = 0; k < BOUGH_TWIGS; k++) {
        let dice = cell_dice(cell, 171u + u32(k));
        let is_last = k == BOUGH_TWIGS - 1;
        let pair = f32(k / 2);
        let side = select(1.0, -1.0, k % 2 == 0);
        let lean = select(side * (0.86 - 0.02 * pair + 0.30 * (dice.x - 0.5)), 0.0, is_last);
        let foot = select(0.04 + 0.112 * pair + 0.04 * (dice.y - 0.5), 0.0, is_last);
        // Shorter to the tip; the last is the bough itself.
        let room = min(foot + 0.12, 1.0 - foot);
        let length = select(clamp(0.78 * room, 0.10, 0.40) * (0.85 + 0.3 * dice.z), 1.0, is_last);
        let ahead = vec2<f32>(sin(lean), cos(lean));
        let away = at - vec2<f32>(0.0, foot);
        let along = clamp(dot(away, ahead), 0.0, length);
        let across = dot(away, vec2<f32>(ahead.y, -ahead.x));
        let part = along / length;
        let needle = abs(fract((along - 1.1 * abs(across)) / NEEDLE_LONG) * 2.0 - 1.0);
        let half = TWIG_WIDE * sqrt(1.0 - 0.9 * part * part * part) * mix(0.86, 0.62 + 0.5 * (1.0 - needle), serrated);
        let depth = half - distance(away, ahead * along);
        if depth > max(deepest, -pixel) {
            deepest = depth;
            let turned = across / half;
            let stem = (1.0 - smoothstep(0.004, 0.009, abs(across))) * (1.0 - 0.8 * part);
            let light = (0.72 + 0.42 * dice.z) * (0.80 + 0.40 * part) * mix(1.0, 0.72 + 0.5 * (1.0 - needle), serrated);
            // Shoots of the year at the ends of twigs are lighter.
            let tint = mix(vec3<f32>(0.92, 1.0, 1.02), vec3<f32>(1.16, 1.12, 0.80), dice.y * part * part);
            twig.tone = mix(light * tint, vec3<f32>(0.80, 0.62, 0.46), 0.6 * stem * serrated);
            twig.tilt = vec2<f32>(ahead.y, -ahead.x) * (0.7 * turned) + (dice.xy - 0.5) * 0.5;
        }
    }
    twig.cover = clamp(deepest / pixel + 0.5, 0.0, 1.0);
    return twig;
}

// Leaves in pairs along a stem, and one at its tip.
fn leaf_on_stem(cell: vec2<i32>, at: vec2<f32>, pixel: f32) -> SprayLeaf {
    var leaf = SprayLeaf(vec3<f32>(0.5), vec2<f32>(0.0), 0.0);
    var deepest = 0.012 - abs(at.x) - 0.02 * step(0.7, at.y);
    for (var k = 0; k < SPRAY_LEAVES; k++) {
        let dice = cell_dice(cell, 71u + u32(k));
        let is_last = k == SPRAY_LEAVES - 1;
        let pair = f32(k / 2);
        let side = select(1.0, -1.0, k % 2 == 0);
        let lean = select(side * (0.98 - 0.07 * pair + 0.5 * (dice.x - 0.5)), 0.3 * (dice.x - 0.5), is_last);
        let foot = select(0.09 + 0.155 * pair + 0.05 * (dice.y - 0.5), 0.64, is_last);
        let length = select((0.37 - 0.025 * pair) * (0.85 + 0.3 * dice.z), 0.35, is_last);
        let ahead = vec2<f32>(sin(lean), cos(lean));
        let away = at - vec2<f32>(0.0, foot);
        let along = dot(away, ahead) / length;
        let across = dot(away, vec2<f32>(ahead.y, -ahead.x)) / length;
        // Widest before the middle, pointed at the tip.
        let half = LEAF_WIDE * 4.4 * along * (1.0 - along) * (1.25 - 0.55 * along);
        let depth = (half - abs(across)) * length;
        if along > 0.0 && along < 1.0 && depth > deepest {
            deepest = depth;
            let vein = 1.0 - smoothstep(0.010, 0.030, abs(across));
            let turned = across / max(half, 1e-3);
            let light = (0.80 + 0.55 * dice.z) * (0.96 + 0.10 * turned) + 0.12 * vein;
            let tint = mix(vec3<f32>(0.92, 1.0, 0.94), vec3<f32>(1.20, 1.06, 0.74), dice.y * dice.y);
            leaf.tone = light * tint;
            leaf.tilt = vec2<f32>(ahead.y, -ahead.x) * (0.4 * turned) + ahead * (0.5 * along) + (dice.xy - 0.5) * 0.9;
        }
    }
    leaf.cover = clamp(deepest / pixel + 0.5, 0.0, 1.0);
    return leaf;
}
