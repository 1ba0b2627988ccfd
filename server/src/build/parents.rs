//! Which clusters a page's vertices can be inherited from: those that its groups were simplified to, in pages before it.

use lodestream_format::cluster::NO_GROUP;

use super::dag::Dag;
use super::paginate::Pages;

/// Places in [`Pages::clusters`] of the clusters that each placed group was simplified to, ascending.
#[derive(Debug)]
pub(super) struct Parents {
    of_group: Vec<Vec<u32>>,
}

impl Parents {
    pub fn new(dag: &Dag, pages: &Pages) -> Self {
        let mut of_group = vec![Vec::new(); pages.groups.len()];
        for (place, &cluster) in (0..).zip(&pages.clusters) {
            let child = dag.clusters[cluster as usize].child_group;
            if child != NO_GROUP {
                of_group[pages.number[child as usize] as usize].push(place);
            }
        }
        Self { of_group }
    }

    /// Those of a page's groups that lie in pages before it.
    pub fn of_page(&self, pages: &Pages, page: usize) -> impl Iterator<Item = usize> {
        let range = pages.pages[page].clone();
        let groups = pages.group_of(range.start)..=pages.group_of(range.end - 1);
        let places = self.of_group[groups].iter().flatten();
        let places = places.map(|&place| place as usize);
        places.filter(move |&place| place < range.start)
    }

    /// Clusters, as numbers in the DAG, that a page's bytes are made from.
    pub fn uses(&self, pages: &Pages, page: usize) -> impl Iterator<Item = u32> {
        let own = pages.pages[page].clone();
        let places = own.chain(self.of_page(pages, page));
        places.map(|place| pages.clusters[place])
    }

    /// How often each run of the store is used by all pages.
    pub fn uses_of_blobs(&self, dag: &Dag, pages: &Pages) -> Vec<u32> {
        let last = dag.clusters.last();
        let mut counts = vec![0; last.map_or(0, |last| last.blob as usize + 1)];
        for page in 0..pages.pages.len() {
            for cluster in self.uses(pages, page) {
                counts[dag.clusters[cluster as usize].blob as usize] += 1;
            }
        }
        counts
    }
}
