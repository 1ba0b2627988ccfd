//! The hierarchy of an asset: an eight-wide BVH over its groups, always resident, read by the GPU as it is.
//!
//! `header (8 words) | nodes | groups | parts`, little-endian words.

use crate::bounds::{Aabb, Sphere};
use crate::cluster::NO_GROUP;
use crate::disk_form::DiskForm;
use crate::error::{FormatError, ensure};
use crate::limits::{HIERARCHY_WIDTH, MAX_GROUP_PARTS, MAX_HIERARCHY_DEPTH};

/// "LSH1".
pub const MAGIC: u32 = u32::from_le_bytes(*b"LSH1");
const HEADER_WORDS: usize = 8;
/// [`Group::parent_error_metres`] of a group that nothing coarser replaces.
pub const ROOT_ERROR: f32 = 1e30;
/// Set in [`Child::reference`] when it names a group.
pub const LEAF_FLAG: u32 = 1 << 31;
/// [`Child::reference`] of an unused child.
pub const NO_CHILD: u32 = u32::MAX;

/// One of a node's eight children.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Child {
    /// Centre of a sphere around the lod spheres of all groups below, local metres.
    pub lod_center: [f32; 3],
    /// Its radius, metres.
    pub lod_radius: f32,
    /// Smallest corner around the clusters of all groups below, local metres.
    pub aabb_min: [f32; 3],
    /// Largest parent error of the groups below, metres.
    pub max_parent_error_metres: f32,
    /// Largest corner.
    pub aabb_max: [f32; 3],
    /// A node, or a group with [`LEAF_FLAG`], or [`NO_CHILD`].
    pub reference: u32,
}

impl Child {
    /// An unused child.
    pub const EMPTY: Child = Child {
        lod_center: [0.0; 3],
        lod_radius: 0.0,
        aabb_min: [0.0; 3],
        max_parent_error_metres: 0.0,
        aabb_max: [0.0; 3],
        reference: NO_CHILD,
    };

    /// The sphere of the pixel-error test.
    pub fn lod_sphere(&self) -> Sphere {
        Sphere {
            center: self.lod_center,
            radius: self.lod_radius,
        }
    }

    /// The box of the frustum test.
    pub fn aabb(&self) -> Aabb {
        Aabb {
            min: self.aabb_min,
            max: self.aabb_max,
        }
    }
}

/// Eight children. Node 0 is the root; children have larger numbers than their parent.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Node {
    /// Unused ones are [`Child::EMPTY`].
    pub children: [Child; HIERARCHY_WIDTH],
}

/// Clusters that were simplified together: one refinement decision.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Group {
    /// Centre of the lod sphere, local metres.
    pub lod_center: [f32; 3],
    /// Radius of the lod sphere, metres.
    pub lod_radius: f32,
    /// Error of the coarser clusters made from this group, metres; [`ROOT_ERROR`] where there are none.
    pub parent_error_metres: f32,
    /// First part.
    pub first_part: u32,
    /// Parts; one a page.
    pub part_count: u32,
    /// First page; part `i` lies in page `first_page + i`.
    pub first_page: u32,
    /// Level of its clusters.
    pub level: u32,
    /// Clusters of all parts.
    pub cluster_count: u32,
    /// Triangles of all clusters.
    pub triangle_count: u32,
    /// Zero.
    pub spare: u32,
}

impl Group {
    /// The sphere of the pixel-error test.
    pub fn lod_sphere(&self) -> Sphere {
        Sphere {
            center: self.lod_center,
            radius: self.lod_radius,
        }
    }

    /// Pages that must be installed before the group is.
    pub fn pages(&self) -> std::ops::Range<u32> {
        self.first_page..self.first_page + self.part_count
    }

    /// Whether nothing coarser exists.
    pub fn is_root(&self) -> bool {
        self.parent_error_metres >= ROOT_ERROR
    }
}

/// The share of a group that lies in one page: consecutive clusters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Part {
    /// First cluster in the page.
    pub first_cluster: u32,
    /// Clusters.
    pub cluster_count: u32,
}

/// The whole object.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Hierarchy {
    /// Nodes; the first is the root.
    pub nodes: Vec<Node>,
    /// Groups, coarse to fine in page order.
    pub groups: Vec<Group>,
    /// Group parts.
    pub parts: Vec<Part>,
    /// Levels of nodes below and with the root.
    pub depth: u32,
}

impl Hierarchy {
    /// The object's bytes.
    pub fn encode(&self) -> Vec<u8> {
        let counts =
            [self.nodes.len(), self.groups.len(), self.parts.len()].map(|count| count as u32);
        let mut bytes =
            bytemuck::bytes_of(&[MAGIC, counts[0], counts[1], counts[2], self.depth, 0, 0, 0])
                .to_vec();
        bytes.extend_from_slice(bytemuck::cast_slice(&self.nodes));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.groups));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.parts));
        bytes
    }

    /// Reads and checks a hierarchy of an asset with `page_count` pages.
    pub fn decode(bytes: &[u8], page_count: u32) -> Result<Self, FormatError> {
        ensure(
            bytes.len() >= 4 * HEADER_WORDS,
            "hierarchy bytes",
            "at least 32",
            bytes.len(),
        )?;
        let header: [u32; HEADER_WORDS] = bytemuck::pod_read_unaligned(&bytes[..4 * HEADER_WORDS]);
        ensure(
            header[0] == MAGIC,
            "hierarchy magic",
            "LSH1",
            format_args!("{:#010x}", header[0]),
        )?;
        let [nodes, groups, parts] = [header[1], header[2], header[3]].map(|count| count as usize);
        ensure(
            nodes > 0 && groups > 0 && groups < LEAF_FLAG as usize,
            "hierarchy nodes and groups",
            "at least one",
            nodes.min(groups),
        )?;
        let node_bytes = nodes.saturating_mul(size_of::<Node>());
        let group_bytes = groups.saturating_mul(size_of::<Group>());
        let part_bytes = parts.saturating_mul(size_of::<Part>());
        let total = (4 * HEADER_WORDS)
            .saturating_add(node_bytes)
            .saturating_add(group_bytes)
            .saturating_add(part_bytes);
        ensure(bytes.len() == total, "hierarchy bytes", total, bytes.len())?;
        let (node_bytes, rest) = bytes[4 * HEADER_WORDS..].split_at(node_bytes);
        let (group_bytes, part_bytes) = rest.split_at(group_bytes);
        let mut hierarchy = Self {
            nodes: bytemuck::allocation::pod_collect_to_vec(node_bytes),
            groups: bytemuck::allocation::pod_collect_to_vec(group_bytes),
            parts: bytemuck::allocation::pod_collect_to_vec(part_bytes),
            depth: 0,
        };
        hierarchy.check_groups(page_count)?;
        hierarchy.depth = hierarchy.check_nodes()?;
        ensure(
            hierarchy.depth == header[4],
            "hierarchy depth",
            hierarchy.depth,
            header[4],
        )?;
        ensure(
            hierarchy.depth <= MAX_HIERARCHY_DEPTH,
            "hierarchy depth",
            format_args!("at most {MAX_HIERARCHY_DEPTH}"),
            hierarchy.depth,
        )?;
        ensure(
            header[5..] == [0; 3],
            "hierarchy spare words",
            "zeros",
            format_args!("{:?}", &header[5..]),
        )?;
        Ok(hierarchy)
    }

    fn check_groups(&self, page_count: u32) -> Result<(), FormatError> {
        let mut part = 0u32;
        for (index, group) in self.groups.iter().enumerate() {
            let at = |field: &str| format!("group {index} {field}");
            check_sphere(&group.lod_sphere(), &at("lod sphere"))?;
            let error = group.parent_error_metres;
            ensure(
                (0.0..=ROOT_ERROR).contains(&error),
                at("parent error"),
                "0..=1e30",
                error,
            )?;
            ensure(
                group.first_part == part,
                at("first part"),
                part,
                group.first_part,
            )?;
            let parts = group.part_count as usize;
            ensure(
                (1..=MAX_GROUP_PARTS).contains(&parts),
                at("parts"),
                "1..=64",
                parts,
            )?;
            let last_page = group.first_page as u64 + group.part_count as u64;
            ensure(
                last_page <= page_count as u64,
                at("pages"),
                format_args!("below {page_count}"),
                last_page,
            )?;
            ensure(
                group.level < 64 && group.spare == 0,
                at("level"),
                "below 64, spare word zero",
                group.level,
            )?;
            let own = self
                .parts
                .get(part as usize..part as usize + parts)
                .ok_or_else(|| {
                    FormatError::new(
                        at("parts"),
                        format!("inside {}", self.parts.len()),
                        part as usize + parts,
                    )
                })?;
            let clusters = own
                .iter()
                .map(|part| part.cluster_count as u64)
                .sum::<u64>();
            ensure(
                clusters == group.cluster_count as u64,
                at("clusters"),
                clusters,
                group.cluster_count,
            )?;
            let empty = own.iter().any(|part| {
                part.cluster_count == 0
                    || part.first_cluster.checked_add(part.cluster_count).is_none()
            });
            ensure(!empty, at("part"), "at least one cluster", "another count")?;
            part += group.part_count;
        }
        ensure(
            part as usize == self.parts.len(),
            "hierarchy parts",
            part,
            self.parts.len(),
        )
    }

    /// Every node but the root and every group is referenced once, children lie inside their node's bounds.
    fn check_nodes(&self) -> Result<u32, FormatError> {
        let mut node_depth = vec![0u32; self.nodes.len()];
        let mut group_seen = vec![false; self.groups.len()];
        node_depth[0] = 1;
        for (index, node) in self.nodes.iter().enumerate() {
            ensure(
                node_depth[index] > 0,
                format_args!("node {index}"),
                "a parent with a smaller number",
                "none",
            )?;
            for (slot, child) in node
                .children
                .iter()
                .enumerate()
                .filter(|(_, child)| child.reference != NO_CHILD)
            {
                let at = format!("node {index} child {slot}");
                check_sphere(&child.lod_sphere(), &at)?;
                let error = child.max_parent_error_metres;
                ensure(
                    (0.0..=ROOT_ERROR).contains(&error),
                    &at,
                    "a parent error of 0..=1e30",
                    error,
                )?;
                let ordered = (0..3).all(|axis| child.aabb_min[axis] <= child.aabb_max[axis])
                    && child
                        .aabb_min
                        .iter()
                        .chain(&child.aabb_max)
                        .all(|value| value.is_finite());
                ensure(
                    ordered,
                    &at,
                    "finite ordered bounds",
                    format_args!("{:?}", child.aabb()),
                )?;
                if child.reference & LEAF_FLAG != 0 {
                    let group = (child.reference & !LEAF_FLAG) as usize;
                    ensure(
                        group < self.groups.len() && !group_seen[group],
                        &at,
                        "a group not seen before",
                        group,
                    )?;
                    group_seen[group] = true;
                    let same = child.max_parent_error_metres
                        == self.groups[group].parent_error_metres
                        && child.lod_sphere() == self.groups[group].lod_sphere();
                    ensure(same, &at, "the group's own error and sphere", group)?;
                } else {
                    let below = child.reference as usize;
                    let fresh = below > index && below < self.nodes.len() && node_depth[below] == 0;
                    ensure(
                        fresh,
                        &at,
                        format_args!("a node after {index} not seen before"),
                        below,
                    )?;
                    node_depth[below] = node_depth[index] + 1;
                    let worst = self.nodes[below]
                        .children
                        .iter()
                        .filter(|inner| inner.reference != NO_CHILD);
                    for inner in worst {
                        let inside = inner.max_parent_error_metres <= error
                            && child.aabb().contains(&inner.aabb());
                        ensure(inside, &at, "bounds and error around those below", below)?;
                    }
                }
            }
        }
        let unseen = group_seen.iter().position(|seen| !seen);
        ensure(
            unseen.is_none(),
            "hierarchy groups",
            "each in one leaf",
            format_args!("{unseen:?} in none"),
        )?;
        Ok(node_depth.into_iter().max().unwrap_or(1))
    }

    /// Checks that a page holds just what the groups say: part ranges and the groups that its clusters name.
    pub fn check_page(&self, form: &DiskForm) -> Result<(), FormatError> {
        let page = form.page();
        let mut groups: Vec<_> = form.headers().iter().map(|header| header.group()).collect();
        groups.dedup();
        let mut next = 0;
        for index in groups {
            let at = format!("page {page} group {index}");
            let group = self
                .groups
                .get(index as usize)
                .ok_or_else(|| FormatError::new(&at, "a known group", index))?;
            ensure(
                group.pages().contains(&page),
                &at,
                format_args!("pages {:?}", group.pages()),
                page,
            )?;
            let part = self.parts[(group.first_part + page - group.first_page) as usize];
            ensure(
                part.first_cluster == next,
                &at,
                format_args!("first cluster {}", part.first_cluster),
                next,
            )?;
            next += part.cluster_count;
            let own = form
                .headers()
                .get(part.first_cluster as usize..next as usize)
                .unwrap_or(&[]);
            let named = !own.is_empty() && own.iter().all(|header| header.group() == index);
            ensure(
                named,
                &at,
                format_args!("{} clusters of the group", part.cluster_count),
                own.len(),
            )?;
        }
        ensure(
            next as usize == form.headers().len(),
            "page clusters",
            next,
            form.headers().len(),
        )?;
        for header in form.headers() {
            let child = header.child_group();
            let known = child == NO_GROUP || (child as usize) < self.groups.len();
            ensure(
                known,
                "child group",
                format_args!("below {}", self.groups.len()),
                child,
            )?;
        }
        Ok(())
    }
}

fn check_sphere(sphere: &Sphere, at: &str) -> Result<(), FormatError> {
    let ok = sphere.center.iter().all(|value| value.is_finite())
        && sphere.radius >= 0.0
        && sphere.radius.is_finite();
    ensure(ok, at, "a finite sphere", format_args!("{sphere:?}"))
}
