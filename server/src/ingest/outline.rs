//! A scene in outline: all of it but what its meshes become.
//!
//! It is a [`Scene`] with an asset entry for every mesh, equal ones too, where the key of the
//! mesh's build stands for the asset, and steps of 1 say which instances may move.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use lodestream_format::scene::{Instance, SceneAsset, Texture};
use lodestream_format::{ContentHash, Scene};

use super::assets::KeyedMesh;
use super::merge::Merged;
use super::records::StoredAsset;
use crate::import::MeshSource;

/// Warnings kept; a scene of many thousand meshes may have one for each.
const MOST_WARNINGS: usize = 200;

/// The entries of `meshes`.
pub(super) fn entries(meshes: &[KeyedMesh]) -> Vec<SceneAsset> {
    let entry = |keyed: &KeyedMesh| SceneAsset {
        name: keyed.mesh.mesh.name().to_owned(),
        asset: keyed.key,
        materials: keyed.mesh.material_slots.clone(),
        steps: keyed.freedom.steps(),
    };
    meshes.iter().map(entry).collect()
}

/// The outline of what was merged, its meshes being `entries`.
pub(super) fn outline(merged: Merged, entries: Vec<SceneAsset>, textures: Vec<Texture>) -> Scene {
    let instances = merged
        .instances
        .into_iter()
        .map(|(mesh, world_from_object)| Instance {
            asset: mesh as u32,
            world_from_object,
        });
    Scene {
        assets: entries,
        instances: instances.collect(),
        materials: merged.materials,
        textures,
        source_triangles: merged.source_triangles,
        warnings: merged.warnings,
    }
}

/// The scene, where `stored` says for each entry of the outline what it became. Meshes that became the same asset with the same
/// materials are one entry of the scene.
pub(super) fn fill(outline: Scene, stored: &[Arc<StoredAsset>]) -> Scene {
    let warnings = warnings(&outline, stored);
    let mut assets: Vec<SceneAsset> = vec![];
    let mut known = HashMap::<(ContentHash, Vec<u32>), u32>::new();
    let mut asset_of_mesh = Vec::with_capacity(stored.len());
    for (entry, stored) in outline.assets.into_iter().zip(stored) {
        let asset = known
            .entry((stored.asset, entry.materials))
            .or_insert_with_key(|(asset, materials)| {
                assets.push(SceneAsset {
                    name: entry.name,
                    asset: *asset,
                    materials: materials.clone(),
                    steps: entry.steps,
                });
                assets.len() as u32 - 1
            });
        // Meshes that became one asset keep still where one of them must.
        let steps = &mut assets[*asset as usize].steps;
        steps.turn = steps.turn.min(entry.steps.turn);
        steps.offset = steps.offset.min(entry.steps.offset);
        asset_of_mesh.push(*asset);
    }
    let mut instances = outline.instances;
    for instance in &mut instances {
        instance.asset = asset_of_mesh[instance.asset as usize];
    }
    Scene {
        assets,
        instances,
        warnings,
        ..outline
    }
}

/// Lines of the import and of every asset's build, as many as are kept.
fn warnings(outline: &Scene, stored: &[Arc<StoredAsset>]) -> Vec<String> {
    let mut lines = outline.warnings.clone();
    let mut told = HashSet::new();
    for (entry, stored) in outline.assets.iter().zip(stored) {
        if told.insert(stored.asset) {
            let named = |line| format!("mesh {:?}: {line}", entry.name);
            lines.extend(stored.report.warnings.iter().map(named));
        }
    }
    if outline.instances.is_empty() {
        lines.push("the inputs hold no triangle: the scene is empty".to_owned());
    }
    if lines.len() > MOST_WARNINGS {
        let more = lines.len() - MOST_WARNINGS;
        lines.truncate(MOST_WARNINGS);
        lines.push(format!("{more} more warnings"));
    }
    lines
}
