//! What residency knows of every page of a scene, flat and scene-wide.

use std::ops::Range;

use lodestream_format::FormatError;

use super::error::StreamError;
use super::opened_scene::OpenedScene;
use super::order::Fetch;

/// What residency has to know of a page; scene-wide numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageFacts {
    /// Bytes on the wire.
    pub frame_bytes: u32,
    /// Words of the memory form.
    pub memory_words: u32,
    /// Whether it is a root page.
    pub is_root: bool,
    /// Pages that it depends on, all smaller.
    pub dependencies: Vec<u32>,
}

/// Sizes and dependencies of all pages.
#[derive(Debug, Clone)]
pub struct ScenePages {
    /// First page of each asset, then the number of all pages.
    bases: Vec<u32>,
    frame_bytes: Vec<u32>,
    is_root: Vec<bool>,
    /// `dependencies[starts[page]..starts[page + 1]]`; root pages are left out: they are always installed.
    starts: Vec<usize>,
    dependencies: Vec<u32>,
}

impl ScenePages {
    /// Over pages without a scene, as a trace has them: root pages stand first in each asset, so an asset begins wherever a
    /// root page follows one that is none.
    ///
    /// # Errors
    /// [`StreamError::Format`] where a page depends on one that is not smaller, or a root page on one that may leave.
    pub fn of_pages(facts: &[PageFacts]) -> Result<Self, StreamError> {
        let mut pages = Self {
            bases: Vec::new(),
            frame_bytes: facts.iter().map(|page| page.frame_bytes).collect(),
            is_root: facts.iter().map(|page| page.is_root).collect(),
            starts: vec![0],
            dependencies: Vec::new(),
        };
        for (page, fact) in facts.iter().enumerate() {
            let fits = |&other: &u32| {
                let other = other as usize;
                other < page && (!fact.is_root || facts[other].is_root)
            };
            if let Some(other) = fact.dependencies.iter().find(|other| !fits(other)) {
                let expected = "smaller ones, and root pages where it is one itself";
                let error =
                    FormatError::new(format!("dependencies of page {page}"), expected, other);
                return Err(StreamError::format("pages")(error));
            }
            if page == 0 || (fact.is_root && !facts[page - 1].is_root) {
                pages.bases.push(page as u32);
            }
            let may_leave = |other: &&u32| !facts[**other as usize].is_root;
            pages
                .dependencies
                .extend(fact.dependencies.iter().filter(may_leave));
            pages.starts.push(pages.dependencies.len());
        }
        pages.bases.push(facts.len() as u32);
        Ok(pages)
    }

    pub(crate) fn new(scene: &OpenedScene) -> Self {
        let mut pages = Self {
            bases: scene.assets.iter().map(|asset| asset.page_base).collect(),
            frame_bytes: Vec::new(),
            is_root: Vec::new(),
            starts: vec![0],
            dependencies: Vec::new(),
        };
        pages.bases.push(scene.page_count());
        for opened in &scene.assets {
            let roots = opened.asset.root_page_count;
            for (local, entry) in (0..).zip(&opened.asset.pages) {
                let needed = entry.dependencies.iter().filter(|&&page| page >= roots);
                pages
                    .dependencies
                    .extend(needed.map(|page| opened.page_base + page));
                pages.starts.push(pages.dependencies.len());
                pages.frame_bytes.push(entry.bytes);
                pages.is_root.push(local < roots);
            }
        }
        pages
    }

    pub(crate) fn count(&self) -> u32 {
        self.frame_bytes.len() as u32
    }

    pub(crate) fn is_root(&self, page: u32) -> bool {
        self.is_root[page as usize]
    }

    /// Bytes on the wire of a page that exists.
    pub fn frame_bytes(&self, page: u32) -> u32 {
        self.frame_bytes[page as usize]
    }

    /// Pages, all smaller, that must be installed before `page`; root pages left out.
    pub(crate) fn dependencies(&self, page: u32) -> &[u32] {
        &self.dependencies[self.starts[page as usize]..self.starts[page as usize + 1]]
    }

    /// Index of the asset of a page that exists.
    pub(crate) fn asset_index(&self, page: u32) -> usize {
        self.bases.partition_point(|&base| base <= page) - 1
    }

    /// Number in its asset of a page that exists.
    pub fn number_in_asset(&self, page: u32) -> u32 {
        page - self.asset_pages(page).start
    }

    /// Scene-wide pages of a fetch.
    pub fn fetched(&self, fetch: &Fetch) -> Range<u32> {
        let base = self.bases[fetch.asset_index];
        base + fetch.first_page..base + fetch.last_page + 1
    }

    /// Pages of the same asset as `page`.
    pub(crate) fn asset_pages(&self, page: u32) -> Range<u32> {
        let index = self.asset_index(page);
        self.bases[index]..self.bases[index + 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(is_root: bool, dependencies: &[u32]) -> PageFacts {
        PageFacts {
            frame_bytes: 1,
            memory_words: 1,
            is_root,
            dependencies: dependencies.to_vec(),
        }
    }

    #[test]
    fn assets_begin_at_root_pages_and_wrong_dependencies_are_named() -> Result<(), StreamError> {
        let facts = [
            page(true, &[]),
            page(true, &[0]),
            page(false, &[1]),
            page(true, &[]),
            page(false, &[2, 3]),
        ];
        let pages = ScenePages::of_pages(&facts)?;
        assert_eq!((pages.asset_pages(2), pages.asset_pages(4)), (0..3, 3..5));
        assert_eq!((pages.number_in_asset(2), pages.number_in_asset(4)), (2, 1));
        assert_eq!(
            (pages.dependencies(2), pages.dependencies(4)),
            (&[][..], &[2][..])
        );
        for wrong in [
            vec![page(true, &[0])],
            vec![page(true, &[]), page(false, &[]), page(true, &[1])],
        ] {
            let error = ScenePages::of_pages(&wrong)
                .map(|_| ())
                .map_err(|error| error.to_string());
            assert!(
                error
                    .as_ref()
                    .is_err_and(|error| error.contains("dependencies of page")),
                "{error:?}"
            );
        }
        Ok(())
    }
}
