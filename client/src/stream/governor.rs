//! Raises the pixel error until what the camera wants fits the pool, and lowers it again when there is room.
//!
//! A page is requested just where its error exceeds the pixel error, so the requests of one update
//! say exactly which pixel error would fit: the error of the first page that finds no slot. Raising
//! takes one step. Lowering has to probe, since nothing below the shown pixel error is requested; a
//! probe that overflowed is not repeated before the view has changed. So a still camera settles:
//! between two changes of the view there are finitely many probes.
//!
//! The caller says when the view changes; where it does not, a change is told from the pages above the shown pixel error,
//! which sees nothing where there are none.

use super::want::Want;

/// Whether the pixel error may leave what the user asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PixelErrorControl {
    /// It rises until the cut fits the pool.
    #[default]
    Governed,
    /// It stays; what does not fit is not fetched. For measuring how policies cope.
    Fixed,
}

/// Why the shown pixel error is what it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PixelErrorLimit {
    /// It is what the user asked for.
    #[default]
    Asked,
    /// The pool is too small for it.
    Pool {
        /// Pages that the last update which did not fit wanted.
        wanted_pages: usize,
        /// Slots that there are.
        slots: usize,
    },
}

/// A view that did not fit, and how it looked above the pixel error that fits it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Overflow {
    at_px: f32,
    seen_above_px: f32,
    look: Look,
}

/// Number and errors of the pages above a pixel error: the same for a still camera, whatever is
/// shown below.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Look {
    pages: f64,
    log_errors: f64,
}

/// Relative change of a [`Look`] that makes it another view.
const VIEW_CHANGE: f64 = 0.02;

#[derive(Debug, Clone)]
pub(crate) struct Governor {
    control: PixelErrorControl,
    asked_px: f32,
    shown_px: f32,
    hold_updates: u32,
    updates_since_change: u32,
    overflow: Option<Overflow>,
    limit: PixelErrorLimit,
}

impl Governor {
    /// `hold_updates`: updates until requests made with a new pixel error are read back, at least.
    pub(crate) fn new(control: PixelErrorControl, asked_px: f32, hold_updates: u32) -> Self {
        Self {
            control,
            asked_px,
            shown_px: asked_px,
            hold_updates,
            updates_since_change: hold_updates,
            overflow: None,
            limit: PixelErrorLimit::Asked,
        }
    }

    pub(crate) fn ask(&mut self, asked_px: f32) {
        if self.shown_px <= self.asked_px || self.shown_px < asked_px {
            self.shown_px = asked_px;
            self.updates_since_change = 0;
        }
        self.asked_px = asked_px;
        self.overflow = None;
    }

    /// The camera or the scene moved: what did not fit may fit now.
    pub(crate) fn view_changed(&mut self) {
        self.overflow = None;
    }

    pub(crate) fn asked_px(&self) -> f32 {
        self.asked_px
    }

    pub(crate) fn shown_px(&self) -> f32 {
        self.shown_px
    }

    pub(crate) fn limit(&self) -> PixelErrorLimit {
        self.limit
    }

    /// Whether the requests of the shown pixel error have come back and call for no other.
    pub(crate) fn is_steady(&self) -> bool {
        self.updates_since_change >= self.hold_updates
    }

    /// Takes what an update wants. Gives the pixel error at or below which wants are to be ignored, if any: requests that
    /// were written before a raise keep coming for some updates.
    pub(crate) fn step(&mut self, wants: &[Want], slots: usize) -> Option<f32> {
        if self.control == PixelErrorControl::Fixed {
            return None;
        }
        self.updates_since_change = self.updates_since_change.saturating_add(1);
        self.forget_another_view(wants);
        let demand = match self.shown_px > self.asked_px {
            true => above(wants, self.shown_px).count(),
            false => wants.len(),
        };
        if demand > slots {
            self.limit = PixelErrorLimit::Pool {
                wanted_pages: demand,
                slots,
            };
            self.raise(wants, slots);
        } else if self.shown_px > self.asked_px && self.is_steady() && demand * 4 <= slots * 3 {
            self.lower(demand, slots);
        }
        if self.shown_px > self.asked_px {
            return Some(self.shown_px);
        }
        self.limit = PixelErrorLimit::Asked;
        None
    }

    fn raise(&mut self, wants: &[Want], slots: usize) {
        let mut errors: Vec<f32> = wants.iter().map(|want| want.error_px).collect();
        let fitting = slots - slots / 16;
        let (_, first_out, _) = errors.select_nth_unstable_by(fitting, |a, b| b.total_cmp(a));
        let raised_px = (*first_out * 1.001).max(self.shown_px.next_up());
        self.overflow = Some(Overflow {
            at_px: self.shown_px,
            seen_above_px: raised_px,
            look: Look::of(wants, raised_px),
        });
        self.shown_px = raised_px;
        self.updates_since_change = 0;
    }

    fn lower(&mut self, demand: usize, slots: usize) {
        // The pages of a surface grow with the inverse square of the pixel error.
        let step = (demand as f32 / slots as f32).sqrt().clamp(0.7, 0.97);
        let floor_px = self
            .overflow
            .map_or(self.asked_px, |overflow| overflow.at_px * 1.01);
        let lowered_px = (self.shown_px * step).max(floor_px).max(self.asked_px);
        if lowered_px <= self.shown_px * 0.995 || lowered_px == self.asked_px {
            self.shown_px = lowered_px;
            self.updates_since_change = 0;
        }
    }

    fn forget_another_view(&mut self, wants: &[Want]) {
        let another = |overflow: &mut Overflow| {
            let look = Look::of(wants, overflow.seen_above_px);
            !look.resembles(&overflow.look)
        };
        self.overflow.take_if(another);
    }
}

fn above(wants: &[Want], px: f32) -> impl Iterator<Item = &Want> {
    wants.iter().filter(move |want| want.error_px > px)
}

impl Look {
    fn of(wants: &[Want], above_px: f32) -> Self {
        let (mut pages, mut log_errors) = (0.0, 0.0);
        for want in above(wants, above_px) {
            pages += 1.0;
            log_errors += (1.0 + want.error_px as f64).log2();
        }
        Self { pages, log_errors }
    }

    fn resembles(&self, other: &Look) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= VIEW_CHANGE * b.abs();
        near(self.pages, other.pages) && near(self.log_errors, other.log_errors)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A still camera over pages of the given errors, its requests read back `lag` updates late.
    fn run(governor: &mut Governor, errors: &[f32], slots: usize, lag: usize, updates: usize) {
        let mut asked = vec![governor.shown_px(); lag + 1];
        for update in 0..updates {
            let px = asked[update % asked.len()];
            let wants: Vec<Want> = (0..)
                .zip(errors)
                .filter(|&(_, &error_px)| error_px > px)
                .map(|(page, &error_px)| Want {
                    page,
                    error_px,
                    priority_px: error_px,
                })
                .collect();
            let threshold = governor.step(&wants, slots).unwrap_or(0.0);
            assert!(
                above(&wants, threshold).count() <= slots,
                "never more than fits"
            );
            let slot = update % asked.len();
            asked[slot] = governor.shown_px();
        }
    }

    fn smooth(pages: u32) -> Vec<f32> {
        (0..pages)
            .map(|page| 100.0 / (1.0 + page as f32).sqrt())
            .collect()
    }

    #[test]
    fn a_still_camera_fills_at_least_two_thirds_of_a_pool_that_is_too_small_and_stays() {
        for lag in [0, 3, 6] {
            let priorities = smooth(5000);
            let mut governor = Governor::new(PixelErrorControl::Governed, 1.0, 8);
            run(&mut governor, &priorities, 300, lag, 400);
            let shown_px = governor.shown_px();
            let fitting = priorities.iter().filter(|&&px| px > shown_px).count();
            assert!(
                (200..=300).contains(&fitting),
                "{fitting} pages at {shown_px} px"
            );
            assert!(governor.is_steady());
            assert!(matches!(
                governor.limit(),
                PixelErrorLimit::Pool { slots: 300, .. }
            ));
            run(&mut governor, &priorities, 300, lag, 200);
            assert_eq!(governor.shown_px(), shown_px);
        }
    }

    #[test]
    fn a_step_that_never_fits_is_probed_once() {
        // A wall seen head on: everything has the same error, so either nothing or too much is
        // wanted.
        let mut governor = Governor::new(PixelErrorControl::Governed, 1.0, 8);
        run(&mut governor, &[5.0; 1000], 100, 4, 300);
        let shown_px = governor.shown_px();
        run(&mut governor, &[5.0; 1000], 100, 4, 300);
        assert_eq!(governor.shown_px(), shown_px);
        assert!(governor.is_steady() && shown_px >= 5.0);
    }

    #[test]
    fn it_comes_back_to_what_was_asked_when_the_view_changes() {
        let mut governor = Governor::new(PixelErrorControl::Governed, 1.0, 8);
        run(&mut governor, &smooth(5000), 300, 4, 100);
        assert!(governor.shown_px() > 2.0);
        run(&mut governor, &smooth(40), 300, 4, 400);
        assert_eq!(governor.shown_px(), 1.0);
        assert_eq!(governor.limit(), PixelErrorLimit::Asked);
        run(&mut governor, &[], 300, 4, 20);
        assert_eq!(governor.shown_px(), 1.0);
    }

    #[test]
    fn asking_for_another_pixel_error_takes_effect() {
        let mut governor = Governor::new(PixelErrorControl::Governed, 1.0, 8);
        governor.ask(4.0);
        assert_eq!(governor.shown_px(), 4.0);
        governor.ask(0.5);
        assert_eq!(governor.shown_px(), 0.5);
        run(&mut governor, &smooth(5000), 300, 4, 200);
        let raised_px = governor.shown_px();
        governor.ask(2.0);
        assert_eq!(governor.shown_px(), raised_px);
        governor.ask(50.0);
        assert_eq!(governor.shown_px(), 50.0);
    }
}
