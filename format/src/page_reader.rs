//! Reads the pages of an asset one after the other, each with the parents that it needs; for tools and tests. Viewers have the
//! parents in their pool.

use std::collections::BTreeMap;

use crate::asset::Asset;
use crate::disk_form::{self, DiskForm};
use crate::error::FormatError;

/// Pages in memory form, as long as a page to come depends on them: of a whole asset about a quarter, those of the level
/// above the one that is read.
#[derive(Debug, Clone)]
pub struct PageReader {
    /// For each page the last that depends on it; itself where none does.
    last_dependent: Vec<u32>,
    /// By that page, then their own.
    pages: BTreeMap<(u32, u32), Vec<u32>>,
}

impl PageReader {
    /// For all pages of an asset, in order; some may be left out where nothing that follows depends on them.
    pub fn new(asset: &Asset) -> Self {
        let mut last_dependent: Vec<u32> = (0..asset.pages.len() as u32).collect();
        for (page, entry) in (0..).zip(&asset.pages) {
            for &dependency in &entry.dependencies {
                last_dependent[dependency as usize] = page;
            }
        }
        Self {
            last_dependent,
            pages: BTreeMap::new(),
        }
    }

    /// Makes the memory form of a page, and lets go of the pages that none to come depends on.
    ///
    /// # Errors
    /// Parents that have not been read, and what [`disk_form::memory_form`] says.
    pub fn read(&mut self, form: &DiskForm) -> Result<&[u32], FormatError> {
        let page = form.page();
        let pages = self.last_dependent.len();
        let Some(&last) = self.last_dependent.get(page as usize) else {
            return Err(FormatError::new("page", format!("below {pages}"), page));
        };
        let words = disk_form::memory_form(form, |parent| self.page(parent))?;
        self.pages = self.pages.split_off(&(page + 1, 0));
        let slot = self.pages.entry((last, page)).or_default();
        *slot = words;
        Ok(slot)
    }

    /// A page that was read and is still needed.
    pub fn page(&self, page: u32) -> Option<&[u32]> {
        let last = *self.last_dependent.get(page as usize)?;
        self.pages.get(&(last, page)).map(Vec::as_slice)
    }
}
