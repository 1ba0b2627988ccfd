//! Pages in disk form (LSD5): parsed, restored from whatever their parents hold, and written again.

use lodestream_format::cluster_view;
use lodestream_format::disk_form::{self, DiskForm};
use lodestream_format::limits::PAGE_WORDS;
use lodestream_format::{Cluster, memory_form};

use super::input::{Input, words};

pub const MOST_BYTES: [usize; 2] = [8 << 20, 512];

/// The memory form that stands for every parent page, behind its length; then the page.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let parent = words(input.sized());
    let words = words(input.0);
    let sections = disk_form::sections(&words);
    let Ok(form) = DiskForm::parse(words.clone()) else {
        return;
    };
    let sum: usize = sections.expect("sections").iter().map(|it| it.1).sum();
    assert_eq!(sum, 4 * words.len());
    assert!(form.memory_words() <= PAGE_WORDS);
    assert!(form.parent_pages().iter().all(|&page| page < form.page()));
    let Ok(memory) = disk_form::memory_form(&form, |_| Some(&parent)) else {
        return;
    };
    assert_eq!(memory.len(), form.memory_words());
    let clusters: Vec<Cluster> = cluster_view::clusters(&memory).collect();
    assert_eq!(clusters.len(), form.headers().len());
    again(&clusters, &form);
}

/// Clusters of a page that passed every check pass those of the writers, too.
fn again(clusters: &[Cluster], form: &DiskForm) {
    let (attributes, page) = (form.attributes(), form.page());
    let memory = memory_form::encode(clusters, attributes, page).expect("a page");
    let back: Vec<Cluster> = cluster_view::clusters(&memory).collect();
    assert_eq!(back, clusters);
    let disk = disk_form::encode(clusters, attributes, page, &[]).expect("a page");
    let form = DiskForm::parse(disk).expect("what was written can be read");
    let memory = disk_form::memory_form(&form, |_| None).expect("no parents");
    let ordered: Vec<Cluster> = clusters.iter().map(disk_form::canonical).collect();
    let back: Vec<Cluster> = cluster_view::clusters(&memory).collect();
    assert_eq!(back, ordered);
}
