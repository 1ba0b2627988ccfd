//! One asset: object, hierarchy, pack, every page, and what they promise each other.

use std::collections::BTreeSet;

use bytes::Bytes;
use lodestream_format::cluster::NO_GROUP;
use lodestream_format::disk_form::DiskForm;
use lodestream_format::hash::ContentHasher;
use lodestream_format::page_reader::PageReader;
use lodestream_format::{Asset, ContentHash, FormatError, Hierarchy, frame, library};
use rayon::prelude::*;

use super::Verifier;
use crate::library::Library;

/// About how many bytes of a pack are in memory at once.
const READ_BYTES: u64 = 8 * 1024 * 1024;

/// What the pages hold together.
#[derive(Default)]
struct Totals {
    clusters: u64,
    triangles: u64,
    /// (finer group, coarser group whose clusters it was simplified to)
    edges: BTreeSet<(u32, u32)>,
}

impl Verifier<'_> {
    pub(super) fn asset(&mut self, hash: &ContentHash) {
        let decoded = self.object(hash, |library, bytes| {
            let wrong = |error| library.damaged(library::object_path(hash), error);
            Asset::decode(bytes).map_err(wrong)
        });
        let Some(asset) = decoded else { return };
        let hierarchy = self.object(&asset.hierarchy, |library: &Library, bytes| {
            let wrong = |error| library.damaged(library::object_path(&asset.hierarchy), error);
            Hierarchy::decode(bytes, asset.pages.len() as u32).map_err(wrong)
        });
        let Some(totals) = self.pack(hash, &asset, hierarchy.as_ref()) else {
            return;
        };
        let mut expect = |at: &str, expected: u64, found: u64| {
            if expected != found {
                let error = FormatError::new(format!("asset {at}"), expected, found);
                self.wrong(library::object_path(hash), error);
            }
        };
        expect("clusters", asset.clusters, totals.clusters);
        expect(
            "triangles of all clusters",
            asset.dag_triangles,
            totals.triangles,
        );
        if let Some(hierarchy) = hierarchy {
            let grouped = hierarchy.groups.iter().map(|g| g.cluster_count as u64);
            expect("clusters of all groups", asset.clusters, grouped.sum());
            for error in edge_faults(&asset, &hierarchy, &totals.edges) {
                self.wrong(library::object_path(hash), error);
            }
        }
    }

    /// Hashes the pack and parses its pages; `None` where pages could not be read.
    fn pack(
        &mut self,
        hash: &ContentHash,
        asset: &Asset,
        hierarchy: Option<&Hierarchy>,
    ) -> Option<Totals> {
        let (mut hasher, mut totals) = (ContentHasher::default(), Totals::default());
        let (mut whole, mut first) = (true, 0);
        let mut reader = PageReader::new(asset);
        while first < asset.pages.len() {
            let last = last_of_read(asset, first);
            let range = asset.pages[first].offset
                ..asset.pages[last].offset + asset.pages[last].bytes as u64;
            let read = self.library.object_range(&asset.pack, range);
            match self.runtime.block_on(read) {
                Ok(bytes) => {
                    hasher.update(&bytes);
                    let read = (&mut totals, &mut reader);
                    whole &= self.pages(hash, asset, hierarchy, first..last + 1, &bytes, read);
                }
                Err(error) => {
                    // Nothing after a missing or short piece can be read either.
                    self.hashed.insert(asset.pack);
                    self.fault(error);
                    return None;
                }
            }
            first = last + 1;
        }
        self.pack_name(asset, hasher.finish());
        whole.then_some(totals)
    }

    /// The pack holds its pages and nothing else.
    fn pack_name(&mut self, asset: &Asset, found: ContentHash) {
        let path = library::object_path(&asset.pack);
        let bytes = match self
            .runtime
            .block_on(self.library.object_bytes(&asset.pack))
        {
            Ok(bytes) => bytes.unwrap_or(0),
            Err(error) => return self.fault(error),
        };
        self.count(&asset.pack, bytes);
        if bytes != asset.pack_bytes() {
            let error = FormatError::new("pack bytes", asset.pack_bytes(), bytes);
            self.wrong(path, error);
        } else if found != asset.pack {
            let error = FormatError::new("object hash", asset.pack, found);
            self.wrong(path, error);
        }
    }

    fn pages(
        &mut self,
        hash: &ContentHash,
        asset: &Asset,
        hierarchy: Option<&Hierarchy>,
        pages: std::ops::Range<usize>,
        bytes: &Bytes,
        (totals, reader): (&mut Totals, &mut PageReader),
    ) -> bool {
        let start = asset.pages[pages.start].offset;
        let parsed: Vec<_> = pages
            .into_par_iter()
            .map(|page| {
                let entry = &asset.pages[page];
                let first = (entry.offset - start) as usize;
                let frame = &bytes[first..first + entry.bytes as usize];
                (page, check_page(asset, hierarchy, page, frame))
            })
            .collect();
        let mut whole = true;
        for (page, parsed) in parsed {
            match parsed {
                Ok(form) => {
                    // A parent that could not be read was told already.
                    let has_parents = form
                        .parent_pages()
                        .into_iter()
                        .all(|it| reader.page(it).is_some());
                    if has_parents && let Err(error) = reader.read(&form) {
                        whole = false;
                        let place = format!("asset {hash} page {page}");
                        self.wrong(place, error);
                    }
                    self.report.pages += 1;
                    self.report.clusters += form.headers().len() as u64;
                    totals.add(&form);
                }
                Err(error) => {
                    whole = false;
                    let place = format!("asset {hash} page {page}");
                    self.wrong(place, error);
                }
            }
        }
        whole
    }
}

impl Totals {
    fn add(&mut self, form: &DiskForm) {
        self.clusters += form.headers().len() as u64;
        for header in form.headers() {
            self.triangles += header.triangle_count() as u64;
            if header.child_group() != NO_GROUP {
                self.edges.insert((header.child_group(), header.group()));
            }
        }
    }
}

/// The last page of one read that begins at `first`.
fn last_of_read(asset: &Asset, first: usize) -> usize {
    let limit = asset.pages[first].offset + READ_BYTES;
    let more = asset.pages[first + 1..]
        .iter()
        .take_while(|entry| entry.offset + entry.bytes as u64 <= limit);
    first + more.count()
}

fn check_page(
    asset: &Asset,
    hierarchy: Option<&Hierarchy>,
    page: usize,
    frame: &[u8],
) -> Result<DiskForm, FormatError> {
    let entry = &asset.pages[page];
    let expect = |ok: bool, at: &str, expected: String, found: String| match ok {
        true => Ok(()),
        false => Err(FormatError::new(at, expected, found)),
    };
    let found = ContentHash::of(frame);
    let same = found == entry.hash;
    expect(
        same,
        "frame hash",
        entry.hash.to_string(),
        found.to_string(),
    )?;
    let form = DiskForm::parse(frame::decode(frame)?)?;
    let (number, words) = (form.page() as usize, form.memory_words());
    expect(
        number == page,
        "page number",
        page.to_string(),
        number.to_string(),
    )?;
    let listed = entry.memory_words as usize;
    expect(
        words == listed,
        "memory words",
        listed.to_string(),
        words.to_string(),
    )?;
    let attributes = (asset.attributes, form.attributes());
    expect(
        attributes.0 == attributes.1,
        "attributes",
        format!("{:?}", attributes.0),
        format!("{:?}", attributes.1),
    )?;
    let astray = form
        .parent_pages()
        .into_iter()
        .find(|parent| entry.dependencies.binary_search(parent).is_err());
    expect(
        astray.is_none(),
        "pages of parents",
        format!("{:?}", entry.dependencies),
        format!("{astray:?}"),
    )?;
    for cluster in 0..form.headers().len() {
        let largest = form.materials(cluster).iter().map(|range| range.slot).max();
        expect(
            largest.is_none_or(|slot| (slot as u32) < asset.material_slots),
            "material slot",
            format!("below {}", asset.material_slots),
            format!("{largest:?}"),
        )?;
    }
    if let Some(hierarchy) = hierarchy {
        hierarchy.check_page(&form)?;
    }
    Ok(form)
}

/// Refining a group needs the pages of its coarser clusters, and its error and sphere lie within theirs.
fn edge_faults(
    asset: &Asset,
    hierarchy: &Hierarchy,
    edges: &BTreeSet<(u32, u32)>,
) -> Vec<FormatError> {
    let mut faults = vec![];
    for &(fine, coarse) in edges {
        // Both are below the number of groups: check_page has seen them.
        let groups = &hierarchy.groups;
        let (finer, coarser) = (&groups[fine as usize], &groups[coarse as usize]);
        let at = format!("group {fine} below group {coarse}");
        if finer.parent_error_metres > coarser.parent_error_metres {
            faults.push(FormatError::new(
                format!("{at}: parent error"),
                format!("at most {}", coarser.parent_error_metres),
                finer.parent_error_metres,
            ));
        }
        if !coarser.lod_sphere().contains(&finer.lod_sphere()) {
            faults.push(FormatError::new(
                format!("{at}: lod sphere"),
                format!("inside {:?}", coarser.lod_sphere()),
                format!("{:?}", finer.lod_sphere()),
            ));
        }
        for page in finer.pages() {
            let dependencies = &asset.pages[page as usize].dependencies;
            let missing = coarser
                .pages()
                .find(|needed| *needed != page && dependencies.binary_search(needed).is_err());
            if let Some(missing) = missing {
                faults.push(FormatError::new(
                    format!("{at}: page {page} dependencies"),
                    format!("page {missing} among them"),
                    format!("{dependencies:?}"),
                ));
            }
        }
    }
    faults
}
