//! The part of a scene that is shown unless another camera is asked for: all of it, or, where a
//! picture of all would show next to nothing, what lies together and holds most of the surface.
//!
//! Surface counts by its triangles: a sky dome or a ground plane has a few, however large it is. A
//! box shows less of its triangles the smaller it is in the picture. The boxes around one place,
//! out to one distance, are taken that show most. Boxes that reach less than [`LEAST_GAP`] times as
//! far belong to them too, and so on outwards. The rest is left out where the picture then shows
//! [`LEAST_GAIN`] times as much.

use glam::DVec3;
use lodestream_format::hierarchy::{LEAF_FLAG, NO_CHILD};
use lodestream_shaders::SceneArrays;
use lodestream_shaders::types::InstanceRecord;

/// Most boxes that are looked at one by one.
const MOST_BOXES: usize = 100_000;
/// Places around which a part is sought.
const PLACES: usize = 32;
/// Share of the picture from which on a box shows all that it has.
const FULL_SHARE: f64 = 0.05;
/// Exponent by which smaller boxes show less: below 1, so that of a row of equal ones more show
/// more.
const SHOWN_EXPONENT: f64 = 0.9;
/// How much farther than the subject the rest has to reach to be left out.
const LEAST_GAP: f64 = 50.0;
/// How much more the picture has to show without it.
const LEAST_GAIN: f64 = 4.0;
/// Distances that are told apart, two to a doubling.
const STEPS: usize = 128;

/// See the module.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Subject {
    /// Corners in world space of the boxes that it consists of, metres.
    pub corners: Vec<DVec3>,
    /// Half the diagonal of the box around it, metres.
    pub radius_metres: f64,
    /// Instances of which something was left out.
    pub instances_outside: u64,
    /// Instances of the scene.
    pub instances: u64,
}

/// A box in world space around some triangles.
#[derive(Debug, Clone, Copy)]
struct Part {
    instance: usize,
    triangles: f64,
    low: DVec3,
    high: DVec3,
    corners: [DVec3; 8],
}

impl Subject {
    /// The subject of a scene.
    pub fn new(arrays: &SceneArrays) -> Self {
        let (parts, unbounded) = parts(arrays);
        let kept = kept(&parts);
        let is_kept = |at: usize| kept.as_ref().is_none_or(|kept| kept[at]);
        let mut outside = vec![false; arrays.instances.len()];
        unbounded
            .iter()
            .for_each(|&instance| outside[instance] = true);
        let (mut corners, mut low, mut high) = (Vec::new(), DVec3::MAX, DVec3::MIN);
        for (at, part) in parts.iter().enumerate() {
            if is_kept(at) {
                corners.extend(part.corners);
                (low, high) = (low.min(part.low), high.max(part.high));
            } else {
                outside[part.instance] = true;
            }
        }
        Self {
            radius_metres: match corners.is_empty() {
                true => 0.0,
                false => 0.5 * (high - low).length(),
            },
            corners,
            instances_outside: outside.iter().filter(|&&it| it).count() as u64,
            instances: outside.len() as u64,
        }
    }

    /// A line for the user where something was left out.
    pub fn note(&self) -> Option<String> {
        (self.instances_outside > 0).then(|| {
            format!(
                "the default camera leaves out {} of {} instances, wholly or in part \
                 (--camera shows them)",
                self.instances_outside, self.instances
            )
        })
    }
}

impl Part {
    fn center(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }

    fn radius(&self) -> f64 {
        0.5 * (self.high - self.low).max_element()
    }

    /// Half the side of the cube around `place` that holds it.
    fn reach(&self, place: DVec3) -> f64 {
        (self.high - place).max(place - self.low).max_element()
    }
}

/// Which parts the subject consists of; `None` for all.
fn kept(parts: &[Part]) -> Option<Vec<bool>> {
    let all = around(parts.iter())?;
    let mut most = (DVec3::ZERO, 0.0, 0.0);
    for place in places(parts) {
        let (radius, shown) = Shown::around(place, parts).best();
        if shown > most.2 {
            most = (place, radius, shown);
        }
    }
    let (place, mut radius, _) = most;
    let mut reaches: Vec<f64> = parts.iter().map(|part| part.reach(place)).collect();
    reaches.sort_by(f64::total_cmp);
    for reach in reaches {
        if reach > radius && reach <= LEAST_GAP * radius {
            radius = reach;
        }
    }
    let is_kept = |part: &&Part| part.reach(place) <= radius;
    let near = around(parts.iter().filter(is_kept))?;
    let before = shown(parts.iter(), &all);
    let after = shown(parts.iter().filter(is_kept), &near);
    let gains = near.radius() > 0.0 && after >= LEAST_GAIN * before;
    gains.then(|| parts.iter().map(|part| is_kept(&part)).collect())
}

/// Triangles that a picture of `frame` shows.
fn shown<'a>(parts: impl Iterator<Item = &'a Part>, frame: &Part) -> f64 {
    let of = |part: &Part| part.triangles * share_shown(part.radius() / frame.radius());
    parts.map(of).sum()
}

/// Middles of some of the parts, those of many triangles more often: a part of the scene that holds
/// a good share of its triangles has one of them.
fn places(parts: &[Part]) -> impl Iterator<Item = DVec3> {
    let triangles: f64 = parts.iter().map(|part| part.triangles).sum();
    let step = triangles / PLACES as f64;
    let mut passed = 0.0;
    let drawn = parts.iter().filter(move |part| {
        let before = (passed / step).floor();
        passed += part.triangles;
        (passed / step).floor() > before
    });
    let most = parts
        .iter()
        .max_by(|a, b| a.triangles.total_cmp(&b.triangles));
    most.into_iter().chain(drawn).take(PLACES).map(Part::center)
}

/// The share of its triangles that a box shows that takes `share` of the picture.
fn share_shown(share: f64) -> f64 {
    match share.is_nan() {
        // A point in a picture of a point.
        true => 1.0,
        false => (share / FULL_SHARE).min(1.0).powf(SHOWN_EXPONENT),
    }
}

/// Triangles by how far their boxes reach from a place and how large these are, in steps from the
/// farthest down.
struct Shown {
    farthest: f64,
    triangles: Vec<[f64; STEPS]>,
}

impl Shown {
    fn around(place: DVec3, parts: &[Part]) -> Self {
        let farthest = parts
            .iter()
            .map(|part| part.reach(place))
            .fold(0.0, f64::max);
        let step = |metres: f64| ((2.0 * (farthest / metres).log2()) as usize).min(STEPS - 1);
        let mut triangles = vec![[0.0; STEPS]; STEPS];
        for part in parts {
            triangles[step(part.reach(place))][step(part.radius())] += part.triangles;
        }
        Self {
            farthest,
            triangles,
        }
    }

    /// The least distance out to which a picture shows most, and how many triangles it shows.
    fn best(&self) -> (f64, f64) {
        let mut within = [0.0; STEPS];
        let (mut best, mut most) = (self.farthest, 0.0);
        for step in (0..STEPS).rev() {
            let sizes = within.iter_mut().zip(&self.triangles[step]);
            sizes.for_each(|(sum, triangles)| *sum += triangles);
            let shares = (0..STEPS).map(|size| 0.5f64.powf(0.5 * (size as f64 - step as f64)));
            let shown: f64 = within
                .iter()
                .zip(shares)
                .map(|(sum, share)| sum * share_shown(share))
                .sum();
            if shown > most {
                (best, most) = (self.farthest * 0.5f64.powf(0.5 * step as f64), shown);
            }
        }
        (best, most)
    }
}

/// The box around boxes.
fn around<'a>(mut parts: impl Iterator<Item = &'a Part>) -> Option<Part> {
    let first = *parts.next()?;
    Some(parts.fold(first, |around, part| Part {
        low: around.low.min(part.low),
        high: around.high.max(part.high),
        ..around
    }))
}

/// Boxes around every instance's source triangles; around whole instances where those would be too
/// many, and around fewer instances where these are. And the instances whose boxes are not finite.
fn parts(arrays: &SceneArrays) -> (Vec<Part>, Vec<usize>) {
    let assets: Vec<AssetBoxes> = (0..arrays.assets.len())
        .map(|asset| AssetBoxes::new(arrays, asset))
        .collect();
    let own = |instance: &InstanceRecord| assets.get(instance.asset as usize);
    let boxes = arrays.instances.iter().filter_map(own);
    let is_fine = boxes.map(|asset| asset.fine.len()).sum::<usize>() <= MOST_BOXES;
    let step = arrays.instances.len().div_ceil(MOST_BOXES).max(1);
    let (mut parts, mut unbounded) = (Vec::new(), Vec::new());
    for (instance, record) in arrays.instances.iter().enumerate().step_by(step) {
        let Some(asset) = own(record) else {
            continue;
        };
        let whole = std::slice::from_ref(&asset.whole);
        for &(bounds, triangles) in if is_fine { &asset.fine } else { whole } {
            let corners = std::array::from_fn(|corner| {
                let pick = |axis: usize| bounds[corner >> axis & 1][axis] as f64;
                record.world_from_local(DVec3::new(pick(0), pick(1), pick(2)))
            });
            if !corners.iter().all(|corner| corner.is_finite()) {
                unbounded.push(instance);
                continue;
            }
            parts.push(Part {
                instance,
                triangles,
                low: corners.into_iter().fold(DVec3::MAX, DVec3::min),
                high: corners.into_iter().fold(DVec3::MIN, DVec3::max),
                corners,
            });
        }
    }
    (parts, unbounded)
}

type LocalBox = [[f32; 3]; 2];

/// Local boxes of an asset with the triangles in them.
struct AssetBoxes {
    whole: (LocalBox, f64),
    /// Of the groups of the finest level, or the whole where it has none.
    fine: Vec<(LocalBox, f64)>,
}

impl AssetBoxes {
    fn new(arrays: &SceneArrays, asset: usize) -> Self {
        let record = &arrays.assets[asset];
        let next = arrays.assets.get(asset + 1);
        let end = next.map_or(arrays.nodes.len(), |next| next.node_base as usize);
        let nodes = arrays.nodes.get(record.node_base as usize..end);
        let leaves = nodes.unwrap_or(&[]).iter().flat_map(|node| &node.children);
        let leaves = leaves.filter(|it| it.reference != NO_CHILD && it.reference & LEAF_FLAG != 0);
        let fine = leaves.filter_map(|child| {
            let number = record.group_base + (child.reference & !LEAF_FLAG);
            let group = arrays.groups.get(number as usize)?;
            let bounds = [child.aabb_min, child.aabb_max];
            (group.level == 0).then_some((bounds, group.triangle_count as f64))
        });
        let mut fine: Vec<_> = fine.collect();
        let triangles: f64 = fine.iter().map(|(_, triangles)| triangles).sum();
        let whole = ([record.aabb_min, record.aabb_max], triangles.max(1.0));
        if fine.is_empty() {
            fine.push(whole);
        }
        Self { whole, fine }
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;
    use lodestream_format::hierarchy::{Child, Group, Node};
    use lodestream_shaders::types::AssetRecord;

    use super::*;

    /// An asset of one group: a cube of half a side of `radius`, with so many triangles.
    fn add_asset(arrays: &mut SceneArrays, radius: f32, triangles: u32) -> u32 {
        let mut asset = AssetRecord::zeroed();
        (asset.aabb_min, asset.aabb_max) = ([-radius; 3], [radius; 3]);
        (asset.node_base, asset.group_base) =
            (arrays.nodes.len() as u32, arrays.groups.len() as u32);
        let mut group = Group::zeroed();
        group.triangle_count = triangles;
        let mut child = Child::zeroed();
        (child.aabb_min, child.aabb_max) = (asset.aabb_min, asset.aabb_max);
        child.reference = LEAF_FLAG;
        let mut node = Node::zeroed();
        node.children = [child; 8];
        node.children[1..]
            .iter_mut()
            .for_each(|child| child.reference = NO_CHILD);
        arrays.assets.push(asset);
        arrays.groups.push(group);
        arrays.nodes.push(node);
        arrays.assets.len() as u32 - 1
    }

    fn place(arrays: &mut SceneArrays, asset: u32, scale: f32, at: [f32; 3]) {
        let mut instance = InstanceRecord::zeroed();
        instance.asset = asset;
        instance.translation_high = at;
        instance.linear_x[0] = scale;
        instance.linear_y[1] = scale;
        instance.linear_z[2] = scale;
        arrays.instances.push(instance);
    }

    fn assert_frames(arrays: &SceneArrays, outside: u64, radius: f64) {
        let subject = Subject::new(arrays);
        assert_eq!(subject.instances_outside, outside);
        let found = subject.radius_metres / 3f64.sqrt();
        assert!((found / radius - 1.0).abs() < 0.01, "{found} for {radius}");
        assert_eq!(subject.note().is_some(), outside > 0);
    }

    #[test]
    fn of_two_far_apart_one_is_framed() {
        let mut arrays = SceneArrays::default();
        let asset = add_asset(&mut arrays, 1.0, 1000);
        place(&mut arrays, asset, 1.0, [0.0; 3]);
        place(&mut arrays, asset, 1.0, [5.4e6, 0.0, 0.0]);
        assert_frames(&arrays, 1, 1.0);
        // A third, and many, each far from all others.
        place(&mut arrays, asset, 1.0, [0.0, 5.4e6, 0.0]);
        assert_frames(&arrays, 2, 1.0);
        for number in 0..97 {
            place(&mut arrays, asset, 1.0, [-1e6 * number as f32, 7e6, 0.0]);
        }
        assert_frames(&arrays, 99, 1.0);
    }

    #[test]
    fn scenes_that_lie_together_are_framed_whole() {
        let mut arrays = SceneArrays::default();
        let asset = add_asset(&mut arrays, 1.0, 1000);
        for number in 0..400u32 {
            let at = [
                (number % 20) as f32 * 15.0,
                0.0,
                (number / 20) as f32 * 15.0,
            ];
            place(&mut arrays, asset, 1.0, at);
        }
        let whole = Subject::new(&arrays);
        assert_eq!((whole.instances_outside, whole.corners.len()), (0, 3200));
        // A plane under them, a car of many triangles among them.
        let plane = add_asset(&mut arrays, 400.0, 2);
        place(&mut arrays, plane, 1.0, [140.0, 0.0, 140.0]);
        let car = add_asset(&mut arrays, 0.5, 2_000_000);
        place(&mut arrays, car, 1.0, [33.0, 0.0, 21.0]);
        assert_eq!(Subject::new(&arrays).instances_outside, 0);
        // Two that are some sizes apart.
        let mut arrays = SceneArrays::default();
        let asset = add_asset(&mut arrays, 1.0, 1000);
        place(&mut arrays, asset, 1.0, [0.0; 3]);
        place(&mut arrays, asset, 1.0, [60.0, 0.0, 0.0]);
        assert_eq!(Subject::new(&arrays).instances_outside, 0);
    }

    #[test]
    fn outliers_leave_the_rest_as_it_was_without_them() {
        let mut arrays = SceneArrays::default();
        let asset = add_asset(&mut arrays, 1.0, 1000);
        for number in 0..50 {
            place(&mut arrays, asset, 1.0, [number as f32 * 8.0, 0.0, 0.0]);
        }
        let without = Subject::new(&arrays);
        assert_eq!(without.instances_outside, 0);
        place(&mut arrays, asset, 0.1, [0.0, 4e5, 0.0]);
        place(&mut arrays, asset, 1.0, [f32::INFINITY, 0.0, 0.0]);
        let with = Subject::new(&arrays);
        assert_eq!(with.corners, without.corners);
        assert_eq!(with.instances_outside, 2);
    }

    #[test]
    fn skies_and_grounds_of_few_triangles_are_left_out() {
        for scale in [1e3f32, 1e6, 1e12] {
            let mut arrays = SceneArrays::default();
            let model = add_asset(&mut arrays, 1.0, 50_000);
            let sky = add_asset(&mut arrays, 1.0, 500);
            place(&mut arrays, model, 1.0, [0.0; 3]);
            place(&mut arrays, sky, scale, [0.0; 3]);
            assert_frames(&arrays, 1, 1.0);
        }
        // A terrain that holds most of the triangles is no background of the house on it.
        let mut arrays = SceneArrays::default();
        let terrain = add_asset(&mut arrays, 5000.0, 100_000);
        let house = add_asset(&mut arrays, 5.0, 5000);
        place(&mut arrays, terrain, 1.0, [0.0; 3]);
        place(&mut arrays, house, 1.0, [0.0; 3]);
        assert_frames(&arrays, 0, 5000.0);
    }

    #[test]
    fn a_crowd_far_away_is_the_subject() {
        let mut arrays = SceneArrays::default();
        let lone = add_asset(&mut arrays, 1.0, 1000);
        let small = add_asset(&mut arrays, 0.1, 1000);
        place(&mut arrays, lone, 1.0, [0.0; 3]);
        for number in 0..1000u32 {
            let at = [1e6 + (number % 32) as f32, (number / 32) as f32, 0.0];
            place(&mut arrays, small, 1.0, at);
        }
        let subject = Subject::new(&arrays);
        assert_eq!(subject.instances_outside, 1);
        assert_eq!(subject.corners.len(), 8000);
    }

    #[test]
    fn empty_and_flat_scenes_have_a_subject() {
        assert_eq!(Subject::new(&SceneArrays::default()), Subject::default());
        let mut arrays = SceneArrays::default();
        let point = add_asset(&mut arrays, 0.0, 1);
        place(&mut arrays, point, 1.0, [3.0; 3]);
        let subject = Subject::new(&arrays);
        assert_eq!((subject.instances_outside, subject.corners.len()), (0, 8));
        place(&mut arrays, point, 1.0, [4.0; 3]);
        assert_eq!(Subject::new(&arrays).corners.len(), 16);
    }
}
