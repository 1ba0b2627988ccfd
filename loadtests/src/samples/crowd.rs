//! One rock many times behind a few that stand once: what `loadtests/priorities.sh` streams.

use super::Glb;
use super::glb::{Material, Node, Scene};
use super::rock::sculpt;
use super::surface::Model;

/// Rocks that stand once, in front.
const SINGLES: usize = 5;
/// Instances of the other beside each other.
const COLUMNS: u32 = 40;
/// Metres from rock to rock.
const STEP_METRES: f64 = 20.0;
/// Metres from a rock's middle to its mean surface.
const RADIUS_METRES: f64 = 8.0;

/// A rock of about `triangles` triangles `instances` times, and five others of as many in front of
/// them, nearer to who looks along -Z.
///
/// The same arguments give the same bytes on every machine.
pub fn crowd(instances: u32, triangles: u32, seed: u64) -> Glb {
    let model = |number: u64| {
        let mut model = Model::new(format!("rock {number}"), false, true);
        *model.part(0, [1.0; 3]) = sculpt(triangles, seed + number, RADIUS_METRES);
        model
    };
    let node = |name: String, mesh: usize, translation: [f64; 3]| Node {
        name: Some(name),
        mesh: Some(mesh),
        translation: Some(translation),
        ..Node::default()
    };
    let middle = 0.5 * f64::from(COLUMNS - 1);
    let many = (0..instances).map(|number| {
        let (column, row) = (f64::from(number % COLUMNS), f64::from(number / COLUMNS));
        let at = [
            (column - middle) * STEP_METRES,
            0.0,
            -(row + 5.0) * STEP_METRES,
        ];
        node(format!("rock 0 at {number}"), 0, at)
    });
    let singles = (1..=SINGLES).map(|number| {
        let aside = number as f64 - 0.5 * (SINGLES + 1) as f64;
        node(
            format!("rock {number}"),
            number,
            [aside * STEP_METRES, 0.0, 0.0],
        )
    });
    let placed: Vec<Node> = many.chain(singles).collect();
    let root = Node {
        name: Some("crowd".into()),
        children: (1..=placed.len()).collect(),
        ..Node::default()
    };
    Scene {
        title: format!("crowd of {instances} rocks, seed {seed}"),
        materials: vec![Material {
            name: "stone",
            base_colour: [1.0; 3],
            roughness: 0.9,
            metallic: 0.0,
            texture: None,
            double_sided: false,
        }],
        textures: Vec::new(),
        models: (0..=SINGLES as u64).map(model).collect(),
        nodes: std::iter::once(root).chain(placed).collect(),
    }
    .finish()
}
