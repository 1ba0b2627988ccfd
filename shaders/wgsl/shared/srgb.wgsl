// sRGB (IEC 61966-2-1) to linear light and back, and packing.

fn linear_from_srgb(encoded: vec3<f32>) -> vec3<f32> {
    let low = encoded / 12.92;
    let high = pow((encoded + 0.055) / 1.055, vec3<f32>(2.4));
    return select(high, low, encoded <= vec3<f32>(0.04045));
}

fn srgb_from_linear(linear: vec3<f32>) -> vec3<f32> {
    let low = linear * 12.92;
    let high = 1.055 * pow(max(linear, vec3<f32>(0.0031308)), vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(high, low, linear <= vec3<f32>(0.0031308));
}

// Opaque RGBA8, the nearest byte; what is not a number becomes 0.
fn pack_color(encoded: vec3<f32>) -> u32 {
    let bytes = vec3<u32>(floor(min(max(encoded, vec3<f32>(0.0)), vec3<f32>(1.0)) * 255.0 + 0.5));
    return bytes.x | (bytes.y << 8u) | (bytes.z << 16u) | 0xff000000u;
}
