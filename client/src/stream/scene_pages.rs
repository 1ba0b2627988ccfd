//! What residency knows of every page of a scene, flat and scene-wide.

use super::opened_scene::OpenedScene;

/// Sizes and dependencies of all pages.
#[derive(Debug, Clone)]
pub(crate) struct ScenePages {
    /// First page of each asset, then the number of all pages.
    bases: Vec<u32>,
    frame_bytes: Vec<u32>,
    is_root: Vec<bool>,
    /// `dependencies[starts[page]..starts[page + 1]]`; root pages are left out: they are always installed.
    starts: Vec<usize>,
    dependencies: Vec<u32>,
}

impl ScenePages {
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

    pub(crate) fn frame_bytes(&self, page: u32) -> u32 {
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

    /// Pages of the same asset as `page`.
    pub(crate) fn asset_pages(&self, page: u32) -> std::ops::Range<u32> {
        let index = self.asset_index(page);
        self.bases[index]..self.bases[index + 1]
    }
}
