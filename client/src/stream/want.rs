//! What one update wants: the streaming requests, closed under dependencies, no more than the pool has slots for.

use lodestream_shaders::cpu::error_metric::PRIORITY_UNITS_A_PX;
use lodestream_shaders::types::RequestRecord;

use super::scene_pages::ScenePages;

/// A streaming request as the GPU writes it and the host reads it back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamingRequest {
    /// Scene-wide page.
    pub page: u32,
    /// Largest projected error that the page removes anywhere, pixels: what the pixel error bounds.
    pub error_px: f32,
    /// Projected errors that it removes, summed over groups and instances, pixels: what orders.
    pub priority_px: f32,
}

impl From<&RequestRecord> for StreamingRequest {
    fn from(record: &RequestRecord) -> Self {
        Self {
            page: record.page,
            error_px: record.error_px,
            priority_px: match record.priority {
                0 => hidden_priority_px(record.error_px),
                units => units as f32 * LEAST_VISIBLE_PX,
            },
        }
    }
}

/// Least priority of a page with a visible group, pixels: one unit.
const LEAST_VISIBLE_PX: f32 = 1.0 / PRIORITY_UNITS_A_PX;

/// Priority of a page whose groups are all hidden: by their error, and below all visible ones.
fn hidden_priority_px(error_px: f32) -> f32 {
    0.5 * LEAST_VISIBLE_PX * (error_px / (1.0 + error_px)).clamp(0.0, 1.0)
}

/// Whether a priority is that of a page whose groups are all hidden.
pub(crate) fn is_hidden(priority_px: f32) -> bool {
    priority_px < LEAST_VISIBLE_PX
}

/// A page that is wanted, by itself or by one that depends on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Want {
    pub(crate) page: u32,
    /// Neither is smaller than that of any wanted page that depends on it.
    pub(crate) error_px: f32,
    pub(crate) priority_px: f32,
}

/// Larger errors and priorities count as this: arithmetic on them stays finite.
const MAX_PRIORITY_PX: f32 = 1e30;

/// How much larger a newcomer's priority must be than that of a wanted page whose slot it takes: without this, two pages
/// of about the same priority would drive each other out for ever.
const HYSTERESIS: f32 = 0.9;

impl Want {
    /// Whether all groups of the page, and of those that depend on it, are hidden.
    pub(crate) fn is_hidden(&self) -> bool {
        is_hidden(self.priority_px)
    }
}

/// Scratch for closing requests, kept between updates.
#[derive(Debug, Clone)]
pub(crate) struct Closure {
    error_px: Vec<f32>,
    priority_px: Vec<f32>,
    /// A bit a page.
    wanted: Vec<u64>,
}

impl Closure {
    pub(crate) fn new(page_count: u32) -> Self {
        Self {
            error_px: vec![0.0; page_count as usize],
            priority_px: vec![0.0; page_count as usize],
            wanted: vec![0; page_count.div_ceil(64) as usize],
        }
    }

    /// The requested pages and all that they depend on, root pages left out, ascending; and how many requests were not
    /// pages of the scene or had an error or a priority that is no number.
    pub(crate) fn close(
        &mut self,
        requests: &[StreamingRequest],
        pages: &ScenePages,
    ) -> (Vec<Want>, u64) {
        let mut ignored = 0;
        for request in requests {
            let has_nan = request.error_px.is_nan() || request.priority_px.is_nan();
            if request.page >= pages.count() || has_nan {
                ignored += 1;
            } else if !pages.is_root(request.page) {
                self.raise(Want {
                    page: request.page,
                    error_px: request.error_px.clamp(0.0, MAX_PRIORITY_PX),
                    priority_px: request.priority_px.clamp(0.0, MAX_PRIORITY_PX),
                });
            }
        }
        // Dependencies have smaller numbers, so one pass downward meets every page after all that depend on it.
        let mut wants = Vec::new();
        for word in (0..self.wanted.len()).rev() {
            while self.wanted[word] != 0 {
                let bit = 63 - self.wanted[word].leading_zeros();
                self.wanted[word] &= !(1 << bit);
                let page = word as u32 * 64 + bit;
                let want = Want {
                    page,
                    error_px: std::mem::take(&mut self.error_px[page as usize]),
                    priority_px: std::mem::take(&mut self.priority_px[page as usize]),
                };
                wants.push(want);
                for &dependency in pages.dependencies(page) {
                    self.raise(Want {
                        page: dependency,
                        ..want
                    });
                }
            }
        }
        wants.reverse();
        (wants, ignored)
    }

    fn raise(&mut self, want: Want) {
        let page = want.page as usize;
        self.wanted[page / 64] |= 1 << (page % 64);
        self.error_px[page] = self.error_px[page].max(want.error_px);
        self.priority_px[page] = self.priority_px[page].max(want.priority_px);
    }
}

/// Keeps the `slots` most urgent of `wants`, closed under dependencies, ascending.
///
/// Installed pages count as more urgent by 1 / [`HYSTERESIS`]. What a page depends on is installed if the page is, has no
/// smaller priority, and a smaller number that decides between equals: so every prefix of the order is closed.
pub(crate) fn admit(wants: &mut Vec<Want>, slots: usize, is_installed: impl Fn(u32) -> bool) {
    if wants.len() <= slots {
        return;
    }
    let urgency = |want: &Want| match is_installed(want.page) {
        true => want.priority_px / HYSTERESIS,
        false => want.priority_px,
    };
    wants.sort_by(|a, b| urgency(b).total_cmp(&urgency(a)).then(a.page.cmp(&b.page)));
    wants.truncate(slots);
    wants.sort_by_key(|want| want.page);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wants(priorities: &[f32]) -> Vec<Want> {
        let numbered = priorities.iter().zip(10..);
        numbered
            .map(|(&priority_px, page)| Want {
                page,
                error_px: 1.0,
                priority_px,
            })
            .collect()
    }

    fn admitted(priorities: &[f32], slots: usize, installed: &[u32]) -> Vec<u32> {
        let mut list = wants(priorities);
        admit(&mut list, slots, |page| installed.contains(&page));
        list.iter().map(|want| want.page).collect()
    }

    #[test]
    fn a_newcomer_needs_a_tenth_more_than_what_it_drives_out() {
        assert_eq!(admitted(&[4.0, 10.0, 9.5], 2, &[]), [11, 12]);
        assert_eq!(admitted(&[10.0, 10.5, 9.5], 2, &[10, 12]), [10, 12]);
        assert_eq!(admitted(&[10.0, 10.6, 9.5], 2, &[10, 12]), [10, 11]);
        assert_eq!(admitted(&[1.0, 1.0, 1.0], 2, &[]), [10, 11]);
        assert_eq!(admitted(&[1.0, 0.0], 2, &[]), [10, 11]);
    }
}
