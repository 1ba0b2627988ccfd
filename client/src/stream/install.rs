//! Decoded pages into slots: evict, upload, install, in the order in which the GPU has to do it.

use lodestream_format::disk_form::DiskForm;

use super::page_state::{PageEvent, PageState};
use super::policy::Candidate;
use super::residency::{NO_SLOT, PageForm, Residency};

/// A page to transcode into its place.
#[derive(Debug, Clone)]
pub struct Upload<Form = DiskForm> {
    /// Scene-wide page.
    pub page: u32,
    /// First word of its place in the pool.
    pub word_offset: u32,
    /// First word of the page of each of the form's parents: installed before, or placed before in the same changes.
    pub parents: Vec<u32>,
    /// What to transcode.
    pub form: Form,
}

/// What the GPU has to do before the next frame's culling, in the order of the fields.
#[derive(Debug, Clone)]
pub struct Changes<Form = DiskForm> {
    /// Pages whose page-table entry becomes `NOT_INSTALLED`.
    pub evicted: Vec<u32>,
    /// Pages to transcode; their places may be those of evicted pages.
    pub uploads: Vec<Upload<Form>>,
    /// Pages whose page-table entry becomes the word offset, once they are transcoded.
    pub installed: Vec<(u32, u32)>,
}

impl<Form> Default for Changes<Form> {
    fn default() -> Self {
        Self {
            evicted: Vec::new(),
            uploads: Vec::new(),
            installed: Vec::new(),
        }
    }
}

impl<Form> Changes<Form> {
    /// Whether there is nothing to do.
    pub fn is_empty(&self) -> bool {
        self.evicted.is_empty() && self.uploads.is_empty() && self.installed.is_empty()
    }
}

impl<Form: PageForm> Residency<Form> {
    /// Hands out the changes since the last call. They must all be applied, in order.
    ///
    /// A page gets a slot when all that it depends on is installed, so no slot ever holds what cannot be drawn, and the
    /// installed set is closed after every call.
    pub fn take_changes(&mut self) -> Changes<Form> {
        let mut changes = Changes::default();
        for upload in std::mem::take(&mut self.roots) {
            self.install(upload, &mut changes);
        }
        let mut order: Vec<u32> = self.decoded.keys().copied().collect();
        // Wanted ones first and by priority: what a page depends on has no smaller priority and a smaller number.
        order.sort_by(|&a, &b| {
            let urgency = |page: u32| match self.is_wanted(page) {
                true => self.records[page as usize].priority_px,
                false => -1.0,
            };
            urgency(b).total_cmp(&urgency(a)).then(a.cmp(&b))
        });
        let mut candidates: Option<Vec<Candidate>> = None;
        for page in order {
            if changes.uploads.len() >= self.max_uploads {
                break;
            }
            let ready = self.dependencies_installed(page);
            if self.is_wanted(page) {
                if !ready {
                    continue;
                }
                if !self.slots.has_free() {
                    let candidates = candidates.get_or_insert_with(|| self.candidates());
                    if !self.evict_one(candidates, &mut changes) {
                        continue;
                    }
                }
                self.place(page, &mut changes);
            } else if ready && self.slots.has_free() {
                self.place(page, &mut changes);
            } else if !self.lingers(page) {
                self.take_decoded(page);
                self.stats.pages_superseded += 1;
                self.step(page, PageEvent::Drop);
            }
        }
        if !changes.is_empty() {
            let states = &self.records;
            self.missing
                .retain(|&page| states[page as usize].state != PageState::Installed);
            self.quiet_updates = 0;
        }
        changes
    }

    fn dependencies_installed(&self, page: u32) -> bool {
        let installed = |&page: &u32| self.state(page) == PageState::Installed;
        self.pages.dependencies(page).iter().all(installed)
    }

    fn take_decoded(&mut self, page: u32) -> Option<Form> {
        self.decoded_bytes -= self.pages.frame_bytes(page) as u64;
        self.decoded.remove(&page)
    }

    fn place(&mut self, page: u32, changes: &mut Changes<Form>) {
        let Some(slot) = self.slots.take(page) else {
            return;
        };
        self.records[page as usize].slot = slot;
        if let Some(form) = self.take_decoded(page) {
            let word_offset = self.layout.slot_word(slot);
            self.install(
                Upload {
                    page,
                    word_offset,
                    parents: Vec::new(),
                    form,
                },
                changes,
            );
        }
    }

    fn install(&mut self, mut upload: Upload<Form>, changes: &mut Changes<Form>) {
        let page = upload.page;
        let first = self.pages.asset_pages(page).start;
        let parents = upload.form.parents().iter();
        upload.parents = parents
            .map(|&[parent, _]| self.word_of(first + parent))
            .collect();
        self.step(page, PageEvent::Place);
        changes.installed.push((page, upload.word_offset));
        changes.uploads.push(upload);
        self.step(page, PageEvent::Install);
        for &dependency in self.pages.dependencies(page) {
            self.records[dependency as usize].installed_dependents += 1;
        }
        self.policy.installed(page, self.update_count);
    }

    /// First word of a page that is a root page or has a slot.
    fn word_of(&self, page: u32) -> u32 {
        let roots = &self.layout.roots;
        match roots.binary_search_by_key(&page, |root| root.0) {
            Ok(root) => roots[root].1,
            Err(_) => self.layout.slot_word(self.records[page as usize].slot),
        }
    }

    /// Whether a page in a slot may leave: nothing wants it, nothing installed depends on it.
    fn may_leave(&self, page: u32) -> bool {
        self.records[page as usize].installed_dependents == 0 && !self.is_wanted(page)
    }

    fn candidate(&self, page: u32) -> Candidate {
        let record = &self.records[page as usize];
        Candidate {
            page,
            last_wanted_update: record.wanted_update,
            priority_px: record.priority_px,
            frame_bytes: self.pages.frame_bytes(page),
        }
    }

    fn candidates(&self) -> Vec<Candidate> {
        let pages = self.slots.pages().filter(|&page| self.may_leave(page));
        pages.map(|page| self.candidate(page)).collect()
    }

    /// Frees the slot of the policy's choice; what it depended on may be the next candidate.
    fn evict_one(&mut self, candidates: &mut Vec<Candidate>, changes: &mut Changes<Form>) -> bool {
        // An unwanted page that was installed in this very call is a candidate only from the next one on: wanted pages come
        // first, so none has been.
        let Some(last) = candidates.len().checked_sub(1) else {
            return false;
        };
        let choice = self.policy.victim(candidates, self.update_count).min(last);
        let victim = candidates.swap_remove(choice).page;
        let slot = std::mem::replace(&mut self.records[victim as usize].slot, NO_SLOT);
        self.slots.give_back(slot);
        self.step(victim, PageEvent::Evict);
        self.stats.pages_evicted += 1;
        self.policy.evicted(victim, self.update_count);
        changes.evicted.push(victim);
        for index in 0..self.pages.dependencies(victim).len() {
            let dependency = self.pages.dependencies(victim)[index];
            self.records[dependency as usize].installed_dependents -= 1;
            if self.may_leave(dependency) {
                candidates.push(self.candidate(dependency));
            }
        }
        true
    }
}
