// The fixed light of every picture, in world space, y up: a hemisphere, a key light from above left in front, a weak wide fill from
// the right behind. Radiances are linear and divided by pi, so that a white matt surface towards the key comes near 1.

// Unit vectors towards the lights.
const KEY_DIRECTION = vec3<f32>(-0.2996255, 0.6991261, 0.6491886);
const FILL_DIRECTION = vec3<f32>(0.9206016, 0.2166121, -0.3249182);
const KEY_RADIANCE = vec3<f32>(0.74, 0.71, 0.66);
const FILL_RADIANCE = vec3<f32>(0.10, 0.12, 0.15);
const SKY_RADIANCE = vec3<f32>(0.27, 0.30, 0.35);
const GROUND_RADIANCE = vec3<f32>(0.15, 0.135, 0.12);
// There is nothing around to reflect, so metals keep this share of a diffuse look.
const METAL_DIFFUSE: f32 = 0.35;
const SMALLEST_ROUGHNESS: f32 = 0.15;
const LARGEST_SPECULAR: f32 = 1.5;
const SKY_TOP_SRGB = vec3<f32>(0.36, 0.43, 0.52);
const SKY_BOTTOM_SRGB = vec3<f32>(0.74, 0.76, 0.78);

fn hemisphere(direction: vec3<f32>) -> vec3<f32> {
    return mix(GROUND_RADIANCE, SKY_RADIANCE, direction.y * 0.5 + 0.5);
}

// Linear radiance towards the eye. `normal` and `to_eye` are unit vectors.
fn light_surface(base_color: vec3<f32>, metallic: f32, roughness: f32, normal: vec3<f32>, to_eye: vec3<f32>) -> vec3<f32> {
    let to_key = max(dot(normal, KEY_DIRECTION), 0.0);
    let to_fill = max((dot(normal, FILL_DIRECTION) + 0.5) / 1.5, 0.0);
    let diffuse = base_color * (1.0 - (1.0 - METAL_DIFFUSE) * metallic);
    let light = hemisphere(normal) + KEY_RADIANCE * to_key + FILL_RADIANCE * to_fill;
    let at_normal = mix(vec3<f32>(0.04), base_color, metallic);
    let toward_eye = max(dot(normal, to_eye), 1e-3);
    let rough = max(roughness, SMALLEST_ROUGHNESS);
    return diffuse * light
        + key_specular(at_normal, rough, normal, to_eye, to_key, toward_eye)
        + hemisphere_specular(at_normal, rough, normal, to_eye, toward_eye);
}

// GGX with the Smith-Schlick visibility of Karis, "Real shading in Unreal Engine 4", 2013.
fn key_specular(
    at_normal: vec3<f32>,
    roughness: f32,
    normal: vec3<f32>,
    to_eye: vec3<f32>,
    to_key: f32,
    toward_eye: f32,
) -> vec3<f32> {
    let half_vector = safe_normalize(KEY_DIRECTION + to_eye, normal);
    let alpha = roughness * roughness;
    let along = max(dot(normal, half_vector), 0.0);
    let spread = along * along * (alpha * alpha - 1.0) + 1.0;
    let facets = alpha * alpha / (spread * spread);
    let k = alpha * 0.5;
    let visibility = 0.25 / ((to_key * (1.0 - k) + k) * (toward_eye * (1.0 - k) + k));
    let rest = 1.0 - max(dot(to_eye, half_vector), 0.0);
    let squared = rest * rest;
    let fresnel = at_normal + (1.0 - at_normal) * (squared * squared * rest);
    return min(fresnel * (facets * visibility * to_key), vec3<f32>(LARGEST_SPECULAR)) * KEY_RADIANCE;
}

// The hemisphere in the mirror direction, weighted by Karis's fit, "Physically based shading on mobile", 2014.
fn hemisphere_specular(
    at_normal: vec3<f32>,
    roughness: f32,
    normal: vec3<f32>,
    to_eye: vec3<f32>,
    toward_eye: f32,
) -> vec3<f32> {
    let fit = vec4<f32>(1.0, 0.0425, 1.04, -0.04) + roughness * vec4<f32>(-1.0, -0.0275, -0.572, 0.022);
    let grazing = min(fit.x * fit.x, exp2(-9.28 * toward_eye)) * fit.x + fit.y;
    let scale = -1.04 * grazing + fit.z;
    let bias = 1.04 * grazing + fit.w;
    let mirrored = 2.0 * dot(normal, to_eye) * normal - to_eye;
    return hemisphere(mirrored) * (at_normal * scale + max(bias, 0.0));
}

// Identity up to 0.75, then bends towards 1 without a kink, so that base colours stay what they are.
fn tone(radiance: vec3<f32>) -> vec3<f32> {
    let over = max(radiance - 0.75, vec3<f32>(0.0));
    return min(radiance, vec3<f32>(0.75)) + over / (1.0 + over * 4.0);
}

// A unit vector, or `otherwise` where `value` has no direction. Divided by its largest part first: squares neither
// overflow nor vanish.
fn safe_normalize(value: vec3<f32>, otherwise: vec3<f32>) -> vec3<f32> {
    let largest = max(abs(value.x), max(abs(value.y), abs(value.z)));
    if !(largest > 1e-37 && largest < 1e38) {
        return otherwise;
    }
    let scaled = value / largest;
    return scaled / sqrt(dot(scaled, scaled));
}
