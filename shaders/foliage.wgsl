// Foliage near the camera: leaves with a tilt of their own in place of a texture.

// Leaves along a repeat of the texture, as in `leaves` of patterns.rs; and sizes of a pixel in leaves between which the
// texture takes over.
const LEAVES_A_REPEAT: f32 = 26.0;
const LEAF_FADE: vec2<f32> = vec2<f32>(0.20, 0.45);

// Sprays of leaves along a repeat of the texture: they are told apart from farther away.
const SPRAYS_A_REPEAT: f32 = 7.0;

struct Leaf {
    // Factor on the albedo of the crown; its mean is 1.
    tone: vec3<f32>,
    // How far the leaf is turned out of the surface, along u and v.
    tilt: vec2<f32>,
    // 0 in the dark between leaves, to 1 on the outermost ones.
    height: f32,
}

// The outermost of the leaves around a place, in leaves.
fn outermost_leaf(at: vec2<f32>) -> Leaf {
    let cell = vec2<i32>(floor(at));
    let part = at - floor(at);
    var leaf = Leaf(vec3<f32>(0.26, 0.30, 0.28), vec2<f32>(0.0), 0.0);
    for (var k = 0; k < 18; k++) {
        // Two to a cell.
        let near = vec2<i32>(k % 3, (k / 3) % 3) - 1;
        let salt = 41u + 2u * u32(k / 9);
        let dice = cell_dice(cell + near, salt);
        let more = cell_dice(cell + near, salt + 1u);
        let away = part - vec2<f32>(near) - dice.xy;
        let turn = 6.2831853 * dice.z;
        let ahead = vec2<f32>(cos(turn), sin(turn));
        let along = dot(away, ahead);
        let across = dot(away, vec2<f32>(-ahead.y, ahead.x));
        // Pointed at both ends, widest before the middle.
        let length = along / 0.78;
        let half_width = 0.36 * (1.0 - length * length) * (1.0 - 0.25 * length);
        let height = 0.2 + 0.8 * more.x - 0.12 * length * length;
        if abs(length) < 1.0 && abs(across) < half_width && height > leaf.height {
            let side = across / half_width;
            let vein = 1.0 - smoothstep(0.02, 0.10, abs(across) / 0.36);
            let light = (0.64 + 1.00 * more.x) * (0.94 + 0.10 * side) + 0.10 * vein;
            // Young leaves are yellower.
            let tint = mix(vec3<f32>(0.92, 1.0, 0.96), vec3<f32>(1.22, 1.06, 0.72), more.y * more.y);
            // Folded along the vein, and drooping to the tip.
            let fold = vec2<f32>(-ahead.y, ahead.x) * (0.35 * sign(side));
            let droop = ahead * (0.55 * length) + (more.yz - 0.5) * 1.2;
            leaf = Leaf(light * tint, fold + droop, height);
        }
    }
    return leaf;
}

// Unit vectors along growing u and v on a surface, from derivatives across the picture (Mikkelsen 2010).
fn surface_axes(normal: vec3<f32>, dx: array<vec3<f32>, 2>, uv_dx: vec4<f32>) -> mat2x3<f32> {
    let across = cross(dx[1], normal);
    let up = cross(normal, dx[0]);
    let u = across * uv_dx.x + up * uv_dx.z;
    let v = across * uv_dx.y + up * uv_dx.w;
    return mat2x3<f32>(u / max(length(u), 1e-9), v / max(length(v), 1e-9));
}

// How much is seen of so many things a repeat, where a pixel has an extent in the texture.
fn foliage_seen(uv_dx: vec4<f32>, per_repeat: f32) -> f32 {
    let area = length(uv_dx.xy) * length(uv_dx.zw);
    return 1.0 - smoothstep(LEAF_FADE.x, LEAF_FADE.y, sqrt(area) * per_repeat);
}

// Twigs of conifers along a repeat of the texture, pairs of needles along a twig, and how far they lean to its tip.
const TWIGS_A_REPEAT: f32 = 15.0;
const NEEDLES_A_TWIG: f32 = 4.5;
const NEEDLE_LEAN: f32 = 1.3;

// The outermost of the twigs around a place, in twigs: they hang, with needles to both sides. `needles_seen` fades the needles.
fn outermost_twig(at: vec2<f32>, needles_seen: f32) -> Leaf {
    let cell = vec2<i32>(floor(at));
    let part = at - floor(at);
    var twig = Leaf(vec3<f32>(0.36, 0.40, 0.42), vec2<f32>(0.0), 0.0);
    for (var k = 0; k < 18; k++) {
        // Two to a cell.
        let near = vec2<i32>(k % 3, (k / 3) % 3) - 1;
        let salt = 51u + 2u * u32(k / 9);
        let dice = cell_dice(cell + near, salt);
        let more = cell_dice(cell + near, salt + 1u);
        let away = part - vec2<f32>(near) - dice.xy;
        let turn = (dice.z - 0.5) * 1.9;
        let ahead = vec2<f32>(sin(turn), -cos(turn));
        let length = dot(away, ahead) / 0.98;
        let across = dot(away, vec2<f32>(-ahead.y, ahead.x));
        let needle = abs(fract(NEEDLES_A_TWIG * (length - NEEDLE_LEAN * abs(across))) * 2.0 - 1.0);
        let half_width = 0.36 * (1.0 - length * length * length * length) * (1.0 - 0.40 * length) * (1.0 - 0.55 * needle * needles_seen);
        let height = 0.2 + 0.8 * more.x - 0.15 * length * length;
        if abs(length) < 1.0 && abs(across) < half_width && height > twig.height {
            let grain = mix(0.94, 0.50 + 0.80 * (1.0 - needle), needles_seen);
            // The young end is lighter, and lies out.
            let light = (0.72 + 0.50 * more.x + 0.30 * max(length, 0.0)) * grain;
            let stem = (1.0 - smoothstep(0.012, 0.030, abs(across))) * (1.0 - smoothstep(0.2, 0.8, length)) * needles_seen;
            let tint = mix(vec3<f32>(0.92, 1.0, 1.03), vec3<f32>(1.12, 1.07, 0.84), more.y * max(length, 0.0));
            let tone = mix(light * tint, vec3<f32>(0.95, 0.72, 0.55), 0.6 * stem);
            let side = vec2<f32>(-ahead.y, ahead.x) * (0.35 * across / max(half_width, 1e-3));
            twig = Leaf(tone, side + ahead * (0.45 * length) + (more.yz - 0.5) * 0.5, height);
        }
    }
    return twig;
}

// Albedo and normal of foliage, and how far out it lies.
struct Foliage {
    albedo: vec3<f32>,
    normal: vec3<f32>,
    height: f32,
}

// Single leaves or needles in place of the texture, where a pixel is small enough. `dx` and `uv_dx` are the derivatives
// of place and texture coordinates across and down the picture.
fn near_foliage(far: Foliage, layer: u32, uv: vec2<f32>, dx: array<vec3<f32>, 2>, uv_dx: vec4<f32>) -> Foliage {
    let spray_seen = foliage_seen(uv_dx, SPRAYS_A_REPEAT);
    if spray_seen <= 0.0 {
        return far;
    }
    let axes = surface_axes(far.normal, dx, uv_dx);
    // Each spray faces its own way, and hides the light from what lies between.
    let spray = stones(uv * SPRAYS_A_REPEAT, 61u);
    let shaded = mix(1.0, 0.74 + 0.34 * spray.w + 0.40 * (spray.z - 0.5), spray_seen);
    let turned = normalize(far.normal + axes * (spray.xy * (1.1 * spray_seen)));
    let is_conifer = layer == NEEDLES;
    let seen = foliage_seen(uv_dx, select(LEAVES_A_REPEAT, TWIGS_A_REPEAT, is_conifer));
    if seen <= 0.0 {
        return Foliage(far.albedo * shaded, turned, far.height);
    }
    var leaf: Leaf;
    if is_conifer {
        leaf = outermost_twig(uv * TWIGS_A_REPEAT, foliage_seen(uv_dx, TWIGS_A_REPEAT * NEEDLES_A_TWIG));
    } else {
        leaf = outermost_leaf(uv * LEAVES_A_REPEAT);
    }
    let tilt = axes * leaf.tilt;
    return Foliage(
        mix(far.albedo, mean_texel(layer).rgb * leaf.tone, seen) * shaded,
        normalize(turned + tilt * (0.75 * seen)),
        mix(far.height, 0.7 * leaf.height, seen),
    );
}

// Widths of the lobes of a crown, of its tufts and of the sprays on these, metres, and distances between which they come in:
// nearer there are sprays and leaves.
const LOBE_M: f32 = 1.7;
const TUFT_M: f32 = 0.75;
const SPRAY_M: f32 = 0.34;
const LOBES_M: vec2<f32> = vec2<f32>(25.0, 60.0);

// A round lump of leaves around a place: its axis from the middle out, its tone, and 0 at its edge to 1 on it.
struct Lobe {
    out: vec3<f32>,
    tone: f32,
    height: f32,
}

// Turned, so that no grid shows on upright or level faces.
const LOBE_AXES: mat3x3<f32> = mat3x3<f32>(
    vec3<f32>(0.36, 0.48, -0.80),
    vec3<f32>(-0.80, 0.60, 0.0),
    vec3<f32>(0.48, 0.64, 0.60),
);

// Cellular noise in space (Worley 1996): of each cell's point, which lies near the middle of it, one of 8 is the nearest.
fn lobe_at(place: vec3<f32>, salt: u32) -> Lobe {
    let at = LOBE_AXES * place;
    let first = floor(at - 0.5);
    var nearest = vec2<f32>(9.0);
    var out = vec3<f32>(0.0);
    var tone = 0.5;
    for (var k = 0; k < 8; k++) {
        let cell = first + vec3<f32>(f32(k & 1), f32((k >> 1u) & 1), f32(k >> 2u));
        let dice = cell_dice(vec2<i32>(cell.xy), salt + 977u * bitcast<u32>(i32(cell.z)));
        let away = at - cell - (0.1 + 0.8 * dice);
        let far = dot(away, away);
        if far < nearest.x {
            nearest = vec2<f32>(far, nearest.x);
            out = away;
            tone = fract(7.0 * (dice.x + dice.y));
        } else if far < nearest.y {
            nearest.y = far;
        }
    }
    let far = sqrt(nearest);
    let height = 0.6 * (1.0 - smoothstep(0.15, 0.80, far.x)) + 0.4 * smoothstep(0.0, 0.45, far.y - far.x);
    return Lobe(out * LOBE_AXES, tone, height);
}

// Crowns at a middle distance, whose meshes have few faces.
struct Lobed {
    leafy: Foliage,
    // How far out the leaves lie at the outline, and how much of that is seen.
    height: f32,
    seen: f32,
}

// Lumps of leaves on lumps: each is round, with shade below it and around. `pixel` is the size of a pixel on the surface, `facing`
// that of one on a surface that faces the eye: at the outline the former is not known.
fn lobed(near: Foliage, world: vec3<f32>, pixel: vec2<f32>, facing: f32) -> Lobed {
    let away = smoothstep(LOBES_M.x, LOBES_M.y, length(world - view.eye.xyz));
    let across = vec2<f32>(facing);
    let outline = away * vec3<f32>(detail_seen(across, LOBE_M), detail_seen(across, TUFT_M), detail_seen(across, SPRAY_M));
    if outline.x <= 0.0 {
        return Lobed(near, 0.0, 0.0);
    }
    let seen = away * vec3<f32>(detail_seen(pixel, LOBE_M), detail_seen(pixel, TUFT_M), detail_seen(pixel, SPRAY_M));
    let lobe = lobe_at(world / LOBE_M, 97u);
    var light = mix(1.0, (0.78 + 0.44 * lobe.height) * (0.86 + 0.28 * lobe.tone), seen.x);
    var round = lobe.out * (1.5 * seen.x);
    var height = 0.5 + 0.5 * lobe.height;
    if outline.y > 0.0 {
        let tuft = lobe_at((world + 0.5 * lobe.out) / TUFT_M, 101u);
        light *= mix(1.0, (0.74 + 0.52 * tuft.height) * (0.82 + 0.36 * tuft.tone), seen.y);
        round += tuft.out * (1.3 * seen.y);
        height *= mix(0.85, 0.45 + 0.75 * tuft.height, outline.y);
        if outline.z > 0.0 {
            let spray = lobe_at((world + 0.3 * tuft.out) / SPRAY_M, 103u);
            light *= mix(1.0, (0.74 + 0.52 * spray.height) * (0.78 + 0.44 * spray.tone), seen.z);
            round += spray.out * (1.1 * seen.z);
            height *= mix(1.0, 0.6 + 0.6 * spray.height, outline.z);
        }
    }
    let turned = normalize(near.normal + round + vec3<f32>(0.0, 0.0, 0.15 * seen.x));
    return Lobed(Foliage(near.albedo * light, turned, near.height), height, outline.x);
}

// Width of a tree of a far wood, and distances between which its trees are told apart by light alone, metres.
const TREE_M: f32 = 6.5;
const WOOD_M: vec2<f32> = vec2<f32>(90.0, 180.0);

// Trees of a far wood, whose mesh is one canopy: each has a round top and a tone of its own.
fn far_wood(near: Foliage, world: vec3<f32>, pixel: vec2<f32>) -> Foliage {
    let away = smoothstep(WOOD_M.x, WOOD_M.y, length(world - view.eye.xyz)) * detail_seen(pixel, TREE_M);
    if away <= 0.0 {
        return near;
    }
    // Up a side of the wood the tops of trees lie above one another.
    let at = (world.xy + vec2<f32>(0.55, 0.40) * world.z) / TREE_M;
    let tree = stones(at, 83u);
    let kind = stones(at * 0.23, 89u).z;
    let light = (0.80 + 0.42 * tree.z) * (0.62 + 0.40 * tree.w);
    let tint = mix(vec3<f32>(0.92, 1.0, 1.02), vec3<f32>(1.16, 1.04, 0.84), kind);
    let top = vec3<f32>(tree.xy * (1.3 * tree.w * away), 0.0);
    return Foliage(near.albedo * mix(vec3<f32>(1.0), light * tint, away), normalize(near.normal + top), near.height);
}
