//! What one update wants: the streaming requests, closed under dependencies, no more than the pool has slots for.

use super::scene_pages::ScenePages;

/// A streaming request as the GPU writes it and the host reads it back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamingRequest {
    /// Scene-wide page.
    pub page: u32,
    /// Projected error that the page removes, pixels.
    pub priority_px: f32,
}

/// A page that is wanted, by itself or by one that depends on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Want {
    pub(crate) page: u32,
    /// Never smaller than that of any wanted page that depends on it.
    pub(crate) priority_px: f32,
}

/// Larger priorities count as this: arithmetic on them stays finite.
const MAX_PRIORITY_PX: f32 = 1e30;

/// How much larger a newcomer's priority must be than that of a wanted page whose slot it takes: without this, two pages
/// of about the same priority would drive each other out for ever.
const HYSTERESIS: f32 = 0.9;

/// Scratch for closing requests, kept between updates.
#[derive(Debug, Clone)]
pub(crate) struct Closure {
    priority_px: Vec<f32>,
    /// A bit a page.
    wanted: Vec<u64>,
}

impl Closure {
    pub(crate) fn new(page_count: u32) -> Self {
        Self {
            priority_px: vec![0.0; page_count as usize],
            wanted: vec![0; page_count.div_ceil(64) as usize],
        }
    }

    /// The requested pages and all that they depend on, root pages left out, ascending; and how many requests were not
    /// pages of the scene or had a priority that is no number.
    pub(crate) fn close(
        &mut self,
        requests: &[StreamingRequest],
        pages: &ScenePages,
    ) -> (Vec<Want>, u64) {
        let mut ignored = 0;
        for request in requests {
            if request.page >= pages.count() || request.priority_px.is_nan() {
                ignored += 1;
            } else if !pages.is_root(request.page) {
                self.raise(
                    request.page,
                    request.priority_px.clamp(0.0, MAX_PRIORITY_PX),
                );
            }
        }
        // Dependencies have smaller numbers, so one pass downward meets every page after all that depend on it.
        let mut wants = Vec::new();
        for word in (0..self.wanted.len()).rev() {
            while self.wanted[word] != 0 {
                let bit = 63 - self.wanted[word].leading_zeros();
                self.wanted[word] &= !(1 << bit);
                let page = word as u32 * 64 + bit;
                let priority_px = self.priority_px[page as usize];
                self.priority_px[page as usize] = 0.0;
                wants.push(Want { page, priority_px });
                for &dependency in pages.dependencies(page) {
                    self.raise(dependency, priority_px);
                }
            }
        }
        wants.reverse();
        (wants, ignored)
    }

    fn raise(&mut self, page: u32, priority_px: f32) {
        self.wanted[page as usize / 64] |= 1 << (page % 64);
        let own = &mut self.priority_px[page as usize];
        *own = own.max(priority_px);
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
            .map(|(&priority_px, page)| Want { page, priority_px })
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
