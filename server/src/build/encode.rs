//! Pages to bytes: disk form, frame, pack, and the asset that names them.

use lodestream_format::asset::PageEntry;
use lodestream_format::frame::{self, Codec};
use lodestream_format::{Aabb, Asset, ContentHash, FormatError, Hierarchy, disk_form};
use rayon::prelude::*;

use super::dag::Dag;
use super::paginate::Pages;
use super::quantize::QuantizedMesh;

/// The objects of an asset.
#[derive(Debug)]
pub(super) struct Encoded {
    pub asset: Asset,
    pub asset_bytes: Vec<u8>,
    pub hierarchy_bytes: Vec<u8>,
    pub pack: Vec<u8>,
    /// Bytes of all disk forms before compression.
    pub disk_form_bytes: u64,
}

/// Encodes pages and hierarchy. Fails only where what was built breaks the format.
pub(super) fn encode(
    mesh: &QuantizedMesh,
    dag: &Dag,
    pages: &Pages,
    hierarchy: &Hierarchy,
    codec: Codec,
) -> Result<Encoded, FormatError> {
    let frames: Vec<(Vec<u8>, u32, usize)> = pages
        .pages
        .par_iter()
        .zip(0..pages.pages.len() as u32)
        .map(|(range, page)| {
            let words = disk_form::encode(&pages.clusters[range.clone()], mesh.attributes, page)?;
            let memory_words = words[disk_form::header_word::MEMORY_WORDS];
            Ok((frame::encode(&words, codec)?, memory_words, 4 * words.len()))
        })
        .collect::<Result<_, FormatError>>()?;
    let mut pack = Vec::with_capacity(frames.iter().map(|(frame, ..)| frame.len()).sum());
    let mut entries = Vec::with_capacity(frames.len());
    let mut disk_form_bytes = 0;
    for ((frame, memory_words, bytes), dependencies) in frames.iter().zip(&pages.dependencies) {
        entries.push(PageEntry {
            offset: pack.len() as u64,
            bytes: frame.len() as u32,
            memory_words: *memory_words,
            hash: ContentHash::of(frame),
            dependencies: dependencies.clone(),
        });
        pack.extend_from_slice(frame);
        disk_form_bytes += *bytes as u64;
    }
    let hierarchy_bytes = hierarchy.encode();
    let dag_triangles = dag
        .clusters
        .iter()
        .map(|cluster| cluster.triangles.len() as u64)
        .sum();
    let asset = Asset {
        attributes: mesh.attributes,
        position_grid: mesh.position_grid,
        uv_grid: mesh.uv_grid,
        center_q: mesh.center_q,
        aabb: pages.clusters.iter().fold(Aabb::EMPTY, |sum, cluster| {
            sum.merge(&cluster.aabb(mesh.position_grid))
        }),
        material_slots: mesh.material_slots,
        source_triangles: mesh.triangles.len() as u64,
        dag_triangles,
        clusters: dag.clusters.len() as u64,
        levels: dag
            .clusters
            .iter()
            .map(|cluster| cluster.level as u32 + 1)
            .max()
            .unwrap_or(1),
        pack: ContentHash::of(&pack),
        hierarchy: ContentHash::of(&hierarchy_bytes),
        root_page_count: pages.root_page_count,
        pages: entries,
    };
    Ok(Encoded {
        asset_bytes: asset.encode()?,
        asset,
        hierarchy_bytes,
        pack,
        disk_form_bytes,
    })
}
