//! Pages with flipped bits that pass the reader's checks go through the GPU: what they say may be nonsense, but it stays within
//! their own words, and where the twin takes it too both give the same bits.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used)] // A test's way to fail.

mod gpu_common;

use gpu_common::{TestScene, gpu, plain_scene};
use lodestream_client::gpu::{PageUpload, Renderer};
use lodestream_format::disk_form::DiskForm;
use lodestream_format::limits::PAGE_WORDS;
use lodestream_shaders::cpu::transcode::transcode;

/// Mutated pages of one submission, and submissions.
const BATCH: usize = 64;
const BATCHES: usize = 16;
/// What lies before, between and behind the pages.
const GUARD: u32 = 0xdead_beef;
const GUARD_WORDS: usize = 64;

/// Xorshift: the same pages on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self, below: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 as usize % below
    }
}

/// One of the pages, whose words in `disk` are those of `places`, changed: it passes all checks of the reader and its parents are in the pool, whose first
/// words come with it.
fn mutated(
    test: &TestScene,
    disk: &[Vec<u32>],
    places: &[(u32, u32)],
    random: &mut Random,
) -> (u32, DiskForm, Vec<u32>) {
    loop {
        let at_page = random.next(places.len());
        let page = places[at_page].0;
        let mut words = disk[at_page].clone();
        for _ in 0..1 + random.next(3) {
            let at = random.next(words.len());
            words[at] = match random.next(4) {
                0 => words[at] ^ 1 << random.next(32),
                1 => words[at]
                    .wrapping_add(random.next(5) as u32)
                    .wrapping_sub(2),
                2 => random.next(1 << 32) as u32,
                _ => [0, u32::MAX, 1 << 31, 128, 256][random.next(5)],
            };
        }
        let Ok(form) = DiskForm::parse(words) else {
            continue;
        };
        let parents = form.parents().iter().map(|&[parent, _]| {
            let parent = test.base(page) + parent;
            let at = places.iter().find(|&&(other, _)| other == parent);
            at.filter(|_| parent < page).map(|&(_, word)| word)
        });
        if let Some(parents) = parents.collect() {
            return (page, form, parents);
        }
    }
}

#[test]
fn what_passes_the_reader_stays_within_its_words() {
    let Some(gpu) = gpu() else { return };
    let test = plain_scene();
    let (places, installed) = test.places(1.0);
    let (twin_pool, page_table) = test.twin_pool(1.0);
    let slot_words = PAGE_WORDS + GUARD_WORDS;
    let first = installed as usize + GUARD_WORDS;
    let pool_words = first + BATCH * slot_words;
    let mut renderer =
        Renderer::new(&gpu, test.arrays.clone(), pool_words as u64, [64, 64]).unwrap();
    let mut before = twin_pool.clone();
    before.resize(pool_words, GUARD);
    let disk: Vec<_> = places
        .iter()
        .map(|&(page, _)| test.disk_words(page))
        .collect();
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let mut alike = 0;
    for _ in 0..BATCHES {
        renderer.write_page(0, &before);
        let pages: Vec<_> = (0..BATCH)
            .map(|_| mutated(&test, &disk, &places, &mut random))
            .collect();
        let slot = |number: usize| first + number * slot_words;
        let uploads: Vec<_> = (0..)
            .zip(&pages)
            .map(|(number, (_, form, parents))| PageUpload {
                form,
                pool_word: slot(number) as u32,
                parents,
            })
            .collect();
        renderer.apply([], &uploads, []).unwrap();
        let found = renderer.read_pool().unwrap();
        assert_eq!(found[..first], before[..first], "what was installed");
        for (number, (page, form, _)) in (0..).zip(&pages) {
            let words = form.memory_words();
            let own = &found[slot(number)..][..slot_words];
            let beyond = own[words..].iter().position(|&word| word != GUARD);
            assert_eq!(beyond, None, "page {page}: words behind its {words}");
            let base = test.base(*page) as usize;
            let parent = |parent: u32| {
                let word = *page_table.get(base + parent as usize)?;
                twin_pool.get(word as usize..)
            };
            if let Ok(expected) = transcode(form, parent) {
                assert_eq!(own[..words], expected, "page {page}");
                alike += 1;
            }
        }
    }
    // Both kinds are there: those whose values nothing can fault, and those that only their vertices give away.
    assert!(alike > BATCH * BATCHES / 4, "{alike}");
    assert!(alike < BATCH * BATCHES, "{alike}");
    println!("{} pages, {alike} that the twin takes too", BATCH * BATCHES);
}
