// Materials: flags (types.rs, `material_flag`), lookup by triangle, texture transform. 
#import types
#import scene
#import cluster

const MATERIAL_DOUBLE_SIDED: u32 = 1u;
const MATERIAL_UNLIT: u32 = 2u;
const MATERIAL_MASK: u32 = 4u;
const MATERIAL_NEAREST: u32 = 8u;
const MATERIAL_CLAMP_U: u32 = 16u;
const MATERIAL_CLAMP_V: u32 = 32u;
const MATERIAL_MIRROR_U: u32 = 64u;
const MATERIAL_MIRROR_V: u32 = 128u;
const NO_TEXTURE: u32 = 0xffffffffu;
const NO_MASK_CUTOFFS: u32 = 0xffffffffu;

fn material_of(asset: AssetRecord, cluster: Cluster, triangle: u32) -> u32 {
    return load_material_slot(asset.material_base + cluster_material_slot(cluster, triangle));
}

// `uv.z` is 1 for a point, 0 for a derivative.
fn transform_uv(material: MaterialRecord, uv: vec3<f32>) -> vec2<f32> {
    return vec2<f32>(dot(material.uv_row_u, uv), dot(material.uv_row_v, uv));
}
