//! A city: thousands of instances of a few detailed meshes on a street grid, among hills.

mod car;
mod crown;
mod facade;
mod furniture;
mod house;
mod land;
mod palette;
mod plan;
mod street;
mod tower;
mod tree;

use super::Glb;
use super::glb::{Node, Scene};
use super::number::{grid, turn};
use super::surface::Model;
use plan::{Block, Item, Kind, Plan};

/// Kinds of mesh in the order in which a city of few unique meshes takes them: (kind, which of the kind).
/// The first eight are what a block cannot do without.
const CATALOGUE: [(Kind, usize); 24] = [
    (Kind::Hills, 0),
    (Kind::Monument, 0),
    (Kind::PavedBlock, 0),
    (Kind::GreenBlock, 0),
    (Kind::Tower, 0),
    (Kind::House, 0),
    (Kind::Tree, 0),
    (Kind::Car, 0),
    (Kind::Lamp, 0),
    (Kind::Tower, 4),
    (Kind::House, 1),
    (Kind::Tree, 1),
    (Kind::Car, 1),
    (Kind::Tower, 2),
    (Kind::Tower, 5),
    (Kind::House, 2),
    (Kind::Tree, 2),
    (Kind::Bench, 0),
    (Kind::Tower, 1),
    (Kind::Car, 2),
    (Kind::House, 3),
    (Kind::Tree, 3),
    (Kind::Tower, 3),
    (Kind::Lamp, 1),
];

/// Fewest unique meshes of a city.
const LEAST_UNIQUE: u32 = 8;
/// Triangles of the monument's stone.
const MONUMENT_TRIANGLES: u32 = 24_000;

/// A city of `instances` instances (at least 1) of `unique` meshes (at least 8): blocks of towers round a monument, then houses and
/// parks, with trees, cars, lamps and benches. Beyond 24 meshes it adds towers, houses, trees and cars.
///
/// Coordinates are metres, y up, the monument at the origin. The same arguments give the same bytes on every
/// machine.
pub fn city(instances: u32, unique: u32, seed: u64) -> Glb {
    let catalogue = catalogue(unique.max(LEAST_UNIQUE) as usize);
    let plan = Plan::new(instances.max(1) as usize, &catalogue, seed);
    let models = catalogue
        .iter()
        .map(|&(kind, which)| model(kind, which, plan.radius_metres, seed));
    Scene {
        title: format!("city of {instances} instances, seed {seed}"),
        materials: palette::materials(),
        textures: palette::textures(),
        models: models.collect(),
        nodes: nodes(&plan.blocks),
    }
    .finish()
}

fn catalogue(unique: usize) -> Vec<(Kind, usize)> {
    let more = (0..unique.saturating_sub(CATALOGUE.len())).map(|index| {
        let round = index / 4;
        match index % 4 {
            0 => (Kind::Tower, 6 + round),
            1 => (Kind::House, 4 + round),
            2 => (Kind::Tree, 4 + round),
            _ => (Kind::Car, 3 + round),
        }
    });
    CATALOGUE.into_iter().take(unique).chain(more).collect()
}

fn model(kind: Kind, which: usize, radius_metres: f64, seed: u64) -> Model {
    match kind {
        Kind::Hills => land::hills(radius_metres, seed),
        Kind::Monument => land::monument(MONUMENT_TRIANGLES, seed),
        Kind::PavedBlock => street::block(false),
        Kind::GreenBlock => street::block(true),
        Kind::Tower => tower::tower(which, seed),
        Kind::House => house::house(which, seed),
        Kind::Tree => tree::tree(which, seed),
        Kind::Car => car::car(which, seed),
        Kind::Lamp => furniture::lamp(which),
        Kind::Bench => furniture::bench(),
    }
}

/// A root, a node for each block, and under it a node for each instance.
fn nodes(blocks: &[Block]) -> Vec<Node> {
    let mut nodes = vec![Node {
        name: Some("city".into()),
        ..Node::default()
    }];
    for (number, block) in blocks.iter().enumerate() {
        let parent = nodes.len();
        nodes[0].children.push(parent);
        nodes.push(Node {
            name: Some(format!("block {number}")),
            translation: Some(block.at),
            children: (parent + 1..=parent + block.items.len()).collect(),
            ..Node::default()
        });
        nodes.extend(block.items.iter().map(instance));
    }
    nodes
}

fn instance(item: &Item) -> Node {
    let (cosine, sine) = turn(item.turns / 2.0);
    let round = |value: f64| (value * 1e6).round() / 1e6;
    Node {
        mesh: Some(item.mesh),
        translation: (item.at != [0.0; 3]).then_some(item.at.map(grid)),
        rotation: (item.turns != 0.0).then_some([0.0, round(sine), 0.0, round(cosine)]),
        scale: (item.scale != 1.0).then_some([grid(item.scale); 3]),
        ..Node::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn city_has_the_instances_and_meshes_asked_for() {
        for (instances, unique) in [(1, 8), (500, 12), (4000, 24)] {
            let catalogue = catalogue(unique);
            let plan = Plan::new(instances, &catalogue, 1);
            let drawn: Vec<usize> = plan
                .blocks
                .iter()
                .flat_map(|b| b.items.iter().map(|i| i.mesh))
                .collect();
            assert_eq!(drawn.len(), instances);
            assert!(drawn.iter().all(|&mesh| mesh < catalogue.len()));
            if instances == 4000 {
                let used: HashSet<_> = drawn.iter().collect();
                assert_eq!(used.len(), unique, "every mesh stands somewhere");
            }
        }
    }

    #[test]
    fn default_city_is_as_detailed_as_promised() {
        let glb = city(4000, 24, 1);
        assert_eq!(glb.instances, 4000);
        assert!(
            (150_000..300_000).contains(&glb.unique_triangles),
            "{}",
            glb.unique_triangles
        );
        assert!(
            glb.instanced_triangles > 20_000_000,
            "{}",
            glb.instanced_triangles
        );
    }

    #[test]
    fn every_mesh_of_the_catalogue_has_valid_indices_unit_normals_and_faces_outward() {
        for (kind, which) in catalogue(28) {
            let model = model(kind, which, 500.0, 1);
            for (material, surface) in &model.parts {
                let context = format!("{} material {material}", model.name);
                let count = surface.positions.len();
                assert_eq!(surface.normals.len(), count, "{context}");
                assert_eq!(surface.uvs.len(), count, "{context}");
                assert_eq!(surface.colours.len(), count, "{context}");
                assert_eq!(surface.indices.len() % 3, 0, "{context}");
                let is_textured = palette::materials()[*material].texture.is_some();
                assert!(
                    model.has_uv || !is_textured || surface.indices.is_empty(),
                    "{context}: textured without coordinates"
                );
                assert!(
                    surface
                        .indices
                        .iter()
                        .all(|&index| (index as usize) < count),
                    "{context}"
                );
                for normal in &surface.normals {
                    let length = normal.iter().map(|v| v * v).sum::<f32>().sqrt();
                    assert!((length - 1.0).abs() < 1e-3, "{context}: {normal:?}");
                }
                let agree = agreement(surface);
                // Leaves shade like their crown, so their own side may look either way.
                assert!(
                    material == &palette::LEAVES || agree > 0.99,
                    "{context}: {agree}"
                );
            }
        }
    }

    /// The share of triangles whose winding agrees with their vertices' normals; 1 where there are none.
    fn agreement(surface: &crate::samples::surface::Surface) -> f64 {
        use glam::DVec3;
        let at =
            |values: &[[f32; 3]], index: u32| DVec3::from(values[index as usize].map(f64::from));
        let triangles = surface.indices.chunks_exact(3);
        let total = triangles.len().max(1) as f64;
        let opposed = triangles
            .filter(|t| {
                let [a, b, c] = [0, 1, 2].map(|k| at(&surface.positions, t[k]));
                let normal: DVec3 = (0..3).map(|k| at(&surface.normals, t[k])).sum();
                (b - a).cross(c - a).dot(normal) < 0.0
            })
            .count();
        1.0 - opposed as f64 / total
    }
}
