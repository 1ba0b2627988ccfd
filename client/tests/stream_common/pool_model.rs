//! The GPU as far as residency sees it: a pool of words, a page table, and what it draws.

use std::collections::BTreeMap;

use lodestream_client::stream::{Changes, NOT_INSTALLED, PoolLayout};

use super::{MadeScene, projected_px};

pub struct PoolModel<'a> {
    scene: &'a MadeScene,
    layout: PoolLayout,
    pub page_table: Vec<u32>,
    /// What was written last, by first word: words, page.
    written: BTreeMap<u32, (u32, u32)>,
}

impl<'a> PoolModel<'a> {
    pub fn new(scene: &'a MadeScene, layout: &PoolLayout) -> Self {
        Self {
            scene,
            layout: layout.clone(),
            page_table: vec![NOT_INSTALLED; scene.opened.page_count() as usize],
            written: BTreeMap::new(),
        }
    }

    /// Applies the changes in the order of the fields, and checks every invariant that they could break.
    pub fn apply(&mut self, changes: &Changes) {
        for &page in &changes.evicted {
            let entry = &mut self.page_table[page as usize];
            assert_ne!(
                *entry, NOT_INSTALLED,
                "page {page} evicted but not installed"
            );
            assert!(
                !self.layout.roots.iter().any(|root| root.0 == page),
                "root page {page} evicted"
            );
            *entry = NOT_INSTALLED;
        }
        for upload in &changes.uploads {
            let first = upload.word_offset;
            let end = first + upload.form.memory_words() as u32;
            assert!(
                end <= self.layout.words(),
                "page {} past the pool",
                upload.page
            );
            let (index, local) = self.scene.opened.locate(upload.page).unwrap();
            assert_eq!(upload.form.page(), local);
            let frame = self.scene.decoded(upload.page);
            assert_eq!(
                upload.form.words(),
                frame.words(),
                "asset {index} page {local}"
            );
            for (page, &word) in (0..).zip(&self.page_table) {
                if word != NOT_INSTALLED {
                    let (words, written) = self.written[&word];
                    assert_eq!(written, page);
                    assert!(
                        end <= word || word + words <= first,
                        "page {} over page {page}",
                        upload.page
                    );
                }
            }
            self.written
                .retain(|&word, (words, _)| end <= word || word + *words <= first);
            self.written.insert(first, (end - first, upload.page));
        }
        for &(page, word) in &changes.installed {
            assert_eq!(
                self.page_table[page as usize], NOT_INSTALLED,
                "page {page} installed twice"
            );
            assert_eq!(self.written[&word].1, page, "page {page} points at another");
            self.page_table[page as usize] = word;
        }
        self.check_closed();
    }

    pub fn is_installed(&self, page: u32) -> bool {
        self.page_table[page as usize] != NOT_INSTALLED
    }

    pub fn installed(&self) -> usize {
        self.page_table
            .iter()
            .filter(|&&word| word != NOT_INSTALLED)
            .count()
    }

    /// Roots are there once anything is; with a page is all that it depends on; slots suffice.
    fn check_closed(&self) {
        for &(page, word) in &self.layout.roots {
            assert_eq!(self.page_table[page as usize], word, "root page {page}");
        }
        for opened in &self.scene.opened.assets {
            for (page, entry) in (opened.page_base..).zip(&opened.asset.pages) {
                if self.is_installed(page) {
                    for dependency in &entry.dependencies {
                        let dependency = opened.page_base + dependency;
                        assert!(
                            self.is_installed(dependency),
                            "page {page} without page {dependency}"
                        );
                    }
                }
            }
        }
        let in_slots = self.installed() - self.layout.roots.len();
        assert!(
            in_slots <= self.layout.slot_count as usize,
            "{in_slots} pages in slots"
        );
    }

    /// What is drawn from `eye` covers everything once: on every way from a root to the source triangles lies exactly one
    /// drawn cluster.
    pub fn check_cut(&self, eye: [f32; 3], pixel_error_px: f32) {
        for (index, made) in self.scene.assets.iter().enumerate() {
            let opened = &self.scene.opened.assets[index];
            let groups = &opened.hierarchy.groups;
            let refine: Vec<bool> = groups
                .iter()
                .map(|group| {
                    let error_px = projected_px(group, eye, 30.0 * index as f32);
                    let mut pages = group.pages().map(|page| opened.page_base + page);
                    pages.all(|page| self.is_installed(page))
                        && (group.is_root() || error_px > pixel_error_px)
                })
                .collect();
            // Fewest and most drawn clusters on any way that ends in the group's members, which are not counted. Coarser groups
            // have smaller numbers, so they are done before.
            let mut drawn_above = vec![(0u32, 0u32); groups.len()];
            for (group, parents) in made.parents.iter().enumerate() {
                let ways = parents.iter().map(|&parent| {
                    let parent = parent as usize;
                    // The cluster that `group` made and `parent` holds.
                    let drawn = (refine[parent] && !refine[group]) as u32;
                    let (fewest, most) = drawn_above[parent];
                    (fewest + drawn, most + drawn)
                });
                let range = ways.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
                drawn_above[group] = range.unwrap_or((0, 0));
                if made.holds_source[group] {
                    // Nothing finer replaces those members.
                    let drawn = refine[group] as u32;
                    let (fewest, most) = drawn_above[group];
                    assert_eq!(
                        (fewest + drawn, most + drawn),
                        (1, 1),
                        "asset {index} group {group}"
                    );
                }
            }
        }
    }
}
