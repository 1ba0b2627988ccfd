//! Hierarchies (LSH1).

use lodestream_format::Hierarchy;

use super::input::Input;

pub const MOST_BYTES: [usize; 2] = [1 << 20, 64];

/// Pages of the asset in two bytes, then the object.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let pages = u32::from(input.short());
    let Ok(hierarchy) = Hierarchy::decode(input.0, pages) else {
        return;
    };
    assert_eq!(hierarchy.encode(), input.0);
    assert!(hierarchy.depth >= 1 && hierarchy.depth as usize <= hierarchy.nodes.len());
    for group in &hierarchy.groups {
        assert!(group.pages().end <= pages);
        let last = (group.first_part + group.part_count) as usize;
        assert!(last <= hierarchy.parts.len());
    }
}
