//! Pages to bytes: disk form, frame, pack, and the asset that names them.

use std::ops::Range;
use std::path::Path;

use lodestream_format::asset::PageEntry;
use lodestream_format::disk_form::Parent;
use lodestream_format::frame::{self, Codec};
use lodestream_format::proxy::Proxy;
use lodestream_format::{Aabb, Asset, Cluster, ContentHash, Hierarchy, disk_form};
use rayon::prelude::*;

use super::cluster::ClusterView;
use super::dag::Dag;
use super::error::BuildError;
use super::pack::{Pack, PackWriter};
use super::paginate::{Pages, to_format};
use super::parents::Parents;
use super::vertex::Grids;

/// Pages encoded at a time: what is in memory does not grow with the mesh.
const WINDOW: usize = 64;

/// The objects of an asset.
#[derive(Debug)]
pub(super) struct Encoded {
    pub asset: Asset,
    pub asset_bytes: Vec<u8>,
    pub hierarchy_bytes: Vec<u8>,
    pub pack: Pack,
    /// Bytes of all disk forms before compression.
    pub disk_form_bytes: u64,
}

/// What the asset says that its pages do not.
#[derive(Debug, Clone)]
pub(super) struct Facts {
    pub material_slots: u32,
    /// Triangles of level 0.
    pub source_triangles: u64,
    pub proxy: Proxy,
}

/// Encodes pages and hierarchy, and lets go of the clusters on the way; the pack lies in `scratch` where a folder is given. Fails only where what was built breaks
/// the format, or the disk is full.
pub(super) fn encode(
    grids: &Grids,
    facts: Facts,
    dag: &mut Dag,
    pages: &Pages,
    hierarchy: &Hierarchy,
    codec: Codec,
    scratch: Option<&Path>,
) -> Result<Encoded, BuildError> {
    let mut pack = PackWriter::new(scratch)?;
    let mut entries = Vec::with_capacity(pages.pages.len());
    let mut disk_form_bytes = 0;
    let parents = Parents::new(dag, pages);
    let mut waiting = parents.uses_of_blobs(dag, pages);
    let numbered: Vec<usize> = (0..pages.pages.len()).collect();
    for window in numbered.chunks(WINDOW) {
        let frames: Vec<(Vec<u8>, u32, usize)> = window
            .par_iter()
            .map(|&page| {
                let words = page_words(grids, &*dag, pages, &parents, page)?;
                let memory_words = words[disk_form::header_word::MEMORY_WORDS];
                Ok((frame::encode(&words, codec)?, memory_words, 4 * words.len()))
            })
            .collect::<Result<_, BuildError>>()?;
        for (&page, (frame, memory_words, bytes)) in window.iter().zip(frames) {
            entries.push(PageEntry {
                offset: pack.bytes(),
                bytes: frame.len() as u32,
                memory_words,
                hash: ContentHash::of(&frame),
                dependencies: pages.dependencies[page].clone(),
            });
            pack.append(frame)?;
            disk_form_bytes += bytes as u64;
            for cluster in parents.uses(pages, page) {
                let blob = dag.clusters[cluster as usize].blob;
                let left = &mut waiting[blob as usize];
                *left -= 1;
                if *left == 0 {
                    dag.store.forget(blob);
                }
            }
        }
    }
    let (pack, pack_hash) = pack.finish()?;
    let hierarchy_bytes = hierarchy.encode();
    let infos = dag.clusters.iter();
    let asset = Asset {
        attributes: grids.attributes,
        position_grid: grids.position,
        uv_grid: grids.uv,
        center_q: grids.center_q,
        aabb: infos
            .clone()
            .fold(Aabb::EMPTY, |sum, info| sum.merge(&info.aabb(grids))),
        material_slots: facts.material_slots,
        source_triangles: facts.source_triangles,
        dag_triangles: infos.clone().map(|info| info.triangle_count as u64).sum(),
        clusters: dag.clusters.len() as u64,
        levels: infos.map(|info| info.level as u32 + 1).max().unwrap_or(1),
        pack: pack_hash,
        hierarchy: ContentHash::of(&hierarchy_bytes),
        proxy: facts.proxy,
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

/// Disk form of a page.
fn page_words(
    grids: &Grids,
    dag: &Dag,
    pages: &Pages,
    parents: &Parents,
    page: usize,
) -> Result<Vec<u32>, BuildError> {
    let places = pages.pages[page].clone();
    let clusters = clusters(grids, dag, pages, places)?;
    let mut used: Vec<(u32, u32)> = Vec::new();
    let mut coarser = Vec::new();
    for place in parents.of_page(pages, page) {
        let holder = pages.page_of(place);
        used.push((holder as u32, (place - pages.pages[holder].start) as u32));
        let parent = self::clusters(grids, dag, pages, place..place + 1)?;
        coarser.extend(parent.iter().map(disk_form::canonical));
    }
    let parents = used.iter().zip(&coarser);
    let parents: Vec<Parent<'_>> = parents
        .map(|(&(page, index), cluster)| Parent {
            page,
            index,
            cluster,
        })
        .collect();
    let page = page as u32;
    Ok(disk_form::encode(
        &clusters,
        grids.attributes,
        page,
        &parents,
    )?)
}

/// The clusters at some places of [`Pages::clusters`].
fn clusters(
    grids: &Grids,
    dag: &Dag,
    pages: &Pages,
    places: Range<usize>,
) -> Result<Vec<Cluster>, BuildError> {
    let numbers = &pages.clusters[places.clone()];
    let parts = dag.parts(numbers)?;
    let mut group = pages.group_of(places.start);
    let mut clusters = Vec::with_capacity(numbers.len());
    for ((&number, part), at) in numbers.iter().zip(&parts).zip(places) {
        while pages.groups[group].clusters.end <= at {
            group += 1;
        }
        let info = &dag.clusters[number as usize];
        let mut cluster = to_format(grids, &ClusterView::new(part));
        cluster.level = info.level;
        cluster.group = group as u32;
        cluster.child_group = match pages.number.get(info.child_group as usize) {
            Some(&child) => child,
            None => info.child_group,
        };
        clusters.push(cluster);
    }
    Ok(clusters)
}
