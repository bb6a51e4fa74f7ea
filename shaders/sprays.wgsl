// Sprays of leaves on trees near the camera: what of a rhombus they cover.

// Texture coordinates from which on leaves are on sprays near the camera, each of which has a cell; width of a spray as a
// share of its length. As in trees/near.rs.
const SPRAY_UV: f32 = 1024.0;
const SPRAY_WIDE: f32 = 0.86;
// Leaves of a spray, the last at its tip, and half the width of a leaf as a share of its length.
const SPRAY_LEAVES: i32 = 9;
const LEAF_WIDE: f32 = 0.24;
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

fn is_spray(uv: vec2<f32>) -> bool {
    return uv.x > SPRAY_UV - 1.0;
}

// Size of a pixel, in sprays, by the derivatives of texture coordinates.
fn pixel_in_sprays(uv_dx: vec2<f32>, uv_dy: vec2<f32>) -> f32 {
    return max(sqrt(length(uv_dx) * length(uv_dy)), 1e-5);
}

// Leaves in pairs along a stem, and one at its tip. `pixel` is the size of a pixel in sprays.
fn spray_leaf(uv: vec2<f32>, pixel: f32) -> SprayLeaf {
    let cell = vec2<i32>(floor(uv + vec2<f32>(0.5, 0.0)));
    // From the foot of the stem: across and along.
    let at = vec2<f32>((uv.x - f32(cell.x)) * SPRAY_WIDE, uv.y - f32(cell.y));
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
    // From afar a spray is an oval of leaves.
    let far = smoothstep(SPRAY_FADE.x, SPRAY_FADE.y, pixel);
    let oval = 0.72 * (1.0 - smoothstep(0.7, 1.0, abs(at.x) / (0.5 * SPRAY_WIDE) + abs(2.0 * at.y - 1.0)));
    leaf.cover = mix(clamp(deepest / pixel + 0.5, 0.0, 1.0), oval, far);
    leaf.tone = mix(leaf.tone, vec3<f32>(1.0), far);
    leaf.tilt *= 1.0 - far;
    return leaf;
}
