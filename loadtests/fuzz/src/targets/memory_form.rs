//! Pages in memory form (LSM2): written from any clusters, read in both ways; and pages in disk form below them.

use lodestream_format::cluster::{Attributes, MaterialRange, NO_GROUP};
use lodestream_format::cluster_view::{self, ClusterView};
use lodestream_format::disk_form::{self, DiskForm, Parent};
use lodestream_format::{Cluster, memory_form};

use super::input::Input;

pub const MOST_BYTES: [usize; 2] = [8 << 20, 4096];

/// Clusters in bytes of their own: attributes, then cluster after cluster.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let attributes = Attributes(u32::from(input.byte()) & Attributes::ALL);
    let mut clusters = Vec::new();
    while !input.0.is_empty() && clusters.len() < 64 {
        clusters.push(cluster(&mut input, attributes));
    }
    let fits = clusters.iter().all(|it| it.check(attributes).is_ok());
    let Ok(memory) = memory_form::encode(&clusters, attributes, 1) else {
        return;
    };
    assert!(fits);
    let back: Vec<Cluster> = cluster_view::clusters(&memory).collect();
    assert_eq!(back, clusters);
    for (view, cluster) in (0..)
        .map_while(|it| ClusterView::new(&memory, it))
        .zip(&clusters)
    {
        for (number, triangle) in (0..).zip(&cluster.triangles) {
            assert_eq!(view.triangle(number), triangle.map(u32::from));
        }
    }
    let parents: Vec<Cluster> = clusters.iter().map(disk_form::canonical).collect();
    let memory = memory_form::encode(&parents, attributes, 1).expect("as many words at most");
    below(&parents, &memory, attributes);
}

/// The same clusters as a page below themselves: nearly all of their vertices are inherited.
fn below(parents: &[Cluster], memory: &[u32], attributes: Attributes) {
    let mut clusters = parents.to_vec();
    clusters.iter_mut().for_each(|it| it.group = 7);
    let named = (0..).zip(parents).map(|(index, cluster)| Parent {
        page: 1,
        index,
        cluster,
    });
    let named: Vec<Parent<'_>> = named.collect();
    let disk = disk_form::encode(&clusters, attributes, 2, &named).expect("a page");
    let form = DiskForm::parse(disk).expect("what was written can be read");
    let words = disk_form::memory_form(&form, |_| Some(memory)).expect("its parents");
    let back: Vec<Cluster> = cluster_view::clusters(&words).collect();
    let ordered: Vec<Cluster> = clusters.iter().map(disk_form::canonical).collect();
    assert_eq!(back, ordered);
}

fn cluster(input: &mut Input<'_>, attributes: Attributes) -> Cluster {
    let vertices = usize::from(input.byte()) + 1;
    let triangles = usize::from(input.byte()) + 1;
    let (scale, flags) = (input.byte(), input.byte());
    let mut wide = |bits: u8| i32::from(input.short() as i16) << (bits % 10);
    let count = |flag| if attributes.has(flag) { vertices } else { 0 };
    let position = |_| std::array::from_fn(|_| wide(scale));
    let positions = (0..vertices).map(position).collect();
    let uv = |_| std::array::from_fn(|_| wide(scale >> 4));
    let uvs = (0..count(Attributes::UV)).map(uv).collect();
    let normal = |_| std::array::from_fn(|_| input.short() & 0x3ff);
    let normals = (0..count(Attributes::NORMAL)).map(normal).collect();
    let color = |_| std::array::from_fn(|_| input.byte());
    let colors = (0..count(Attributes::COLOR)).map(color).collect();
    let triangle = |_| std::array::from_fn(|_| input.byte());
    let triangles: Vec<[u8; 3]> = (0..triangles).map(triangle).collect();
    let mut materials: Vec<MaterialRange> = Vec::new();
    let mut left = triangles.len() as u16;
    while left > 0 {
        let (slot, run) = (input.short(), u16::from(input.byte()).clamp(1, left));
        left -= run;
        // Neighbours of one slot say the same as one range.
        match materials.last_mut() {
            Some(last) if last.slot == slot => last.triangle_count += run,
            _ => materials.push(MaterialRange {
                slot,
                triangle_count: run,
            }),
        }
    }
    Cluster {
        positions,
        normals,
        uvs,
        colors,
        triangles,
        materials,
        level: flags & 0x7f,
        group: u32::from(flags),
        child_group: if flags & 1 == 0 { NO_GROUP } else { 7 },
    }
}
