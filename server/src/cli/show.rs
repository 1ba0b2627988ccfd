//! `list` and `show`: what a library and a scene hold.

use std::collections::{BTreeMap, BTreeSet};

use futures_util::{StreamExt, TryStreamExt, stream};
use lodestream_format::{Asset, ContentHash, Scene};
use tokio::runtime::Handle;

use super::args::{ListArgs, ShowArgs};
use super::commands::CommandError;
use super::output::{self, line};
use crate::library::{Library, LibraryError};

/// Objects read at once.
const READS_AT_ONCE: usize = 16;

/// Lists the scenes.
pub(super) fn list(handle: &Handle, args: &ListArgs) -> Result<(), CommandError> {
    let library = handle.block_on(Library::open_existing(&args.library.library))?;
    if args.assets {
        return list_assets(handle, args, &library);
    }
    let scenes = handle.block_on(library.scenes(None, usize::MAX))?;
    output::report(args.library.report.as_deref(), &scenes)?;
    for entry in &scenes.scenes {
        line(format_args!("{}\t{}", entry.name, entry.reference.scene));
    }
    Ok(())
}

/// What `list --assets` tells of a scene.
#[derive(Debug, serde::Serialize)]
struct SharedFigures {
    name: String,
    scene: ContentHash,
    assets: u64,
    shared_assets: u64,
    pack_bytes: u64,
    shared_pack_bytes: u64,
}

fn list_assets(handle: &Handle, args: &ListArgs, library: &Library) -> Result<(), CommandError> {
    let figures = handle.block_on(async {
        let scenes = all_scenes(library).await?;
        let users = users(&scenes);
        let assets = assets(library, users.keys().copied().collect()).await?;
        let figures = scenes.iter().map(|(name, hash, scene)| {
            let unique = unique(scene);
            let shared = |hash: &&ContentHash| users[*hash].len() > 1;
            let bytes = |hash: &ContentHash| assets[hash].pack_bytes();
            SharedFigures {
                name: name.clone(),
                scene: *hash,
                assets: unique.len() as u64,
                shared_assets: unique.iter().filter(shared).count() as u64,
                pack_bytes: unique.iter().map(bytes).sum(),
                shared_pack_bytes: unique.iter().filter(shared).map(bytes).sum(),
            }
        });
        Ok::<Vec<_>, LibraryError>(figures.collect())
    })?;
    output::report(args.library.report.as_deref(), &figures)?;
    for scene in &figures {
        line(format_args!(
            "{}\t{}\t{} assets\t{} shared\t{} pack bytes\t{} shared",
            scene.name,
            scene.scene,
            scene.assets,
            scene.shared_assets,
            scene.pack_bytes,
            scene.shared_pack_bytes,
        ));
    }
    Ok(())
}

/// Every scene that is there, with its name and object.
async fn all_scenes(library: &Library) -> Result<Vec<(String, ContentHash, Scene)>, LibraryError> {
    let page = library.scenes(None, usize::MAX).await?;
    stream::iter(page.scenes)
        .map(|entry| async move {
            let hash = entry.reference.scene;
            Ok((entry.name, hash, library.scene(&hash).await?))
        })
        .buffered(READS_AT_ONCE)
        .try_collect()
        .await
}

/// The scenes that use each asset.
fn users(scenes: &[(String, ContentHash, Scene)]) -> BTreeMap<ContentHash, BTreeSet<&str>> {
    let mut users = BTreeMap::<_, BTreeSet<_>>::new();
    for (name, _, scene) in scenes {
        for asset in unique(scene) {
            users.entry(asset).or_default().insert(name.as_str());
        }
    }
    users
}

fn unique(scene: &Scene) -> BTreeSet<ContentHash> {
    scene.assets.iter().map(|used| used.asset).collect()
}

async fn assets(
    library: &Library,
    hashes: BTreeSet<ContentHash>,
) -> Result<BTreeMap<ContentHash, Asset>, LibraryError> {
    stream::iter(hashes)
        .map(|hash| async move { Ok((hash, library.asset(&hash).await?)) })
        .buffered(READS_AT_ONCE)
        .try_collect()
        .await
}

/// What `show` tells.
#[derive(Debug, serde::Serialize)]
struct SceneFigures {
    name: String,
    scene: ContentHash,
    published_secs: u64,
    assets: u64,
    instances: u64,
    materials: u64,
    textures: u64,
    source_triangles: u64,
    dag_triangles: u64,
    clusters: u64,
    levels: u32,
    pages: u64,
    pack_bytes: u64,
    texture_bytes: u64,
    warnings: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    assets_table: Option<Vec<AssetRow>>,
}

/// An asset of a scene.
#[derive(Debug, serde::Serialize)]
struct AssetRow {
    asset: ContentHash,
    name: String,
    /// Instances in this scene.
    instances: u64,
    other_scenes: Vec<String>,
    source_triangles: u64,
    pack_bytes: u64,
}

/// Shows a scene.
pub(super) fn show(handle: &Handle, args: &ShowArgs) -> Result<(), CommandError> {
    let of = &args.scene.library;
    let library = handle.block_on(Library::open_existing(&of.library))?;
    let figures = handle.block_on(figures(&library, &args.scene.scene, args.assets))?;
    output::report(of.report.as_deref(), &figures)?;
    for (name, value) in [
        ("scene", figures.scene.to_string()),
        ("published_secs", figures.published_secs.to_string()),
        ("assets", figures.assets.to_string()),
        ("instances", figures.instances.to_string()),
        ("materials", figures.materials.to_string()),
        ("textures", figures.textures.to_string()),
        ("source_triangles", figures.source_triangles.to_string()),
        ("dag_triangles", figures.dag_triangles.to_string()),
        ("clusters", figures.clusters.to_string()),
        ("levels", figures.levels.to_string()),
        ("pages", figures.pages.to_string()),
        ("pack_bytes", figures.pack_bytes.to_string()),
        ("texture_bytes", figures.texture_bytes.to_string()),
    ] {
        line(format_args!("{name}\t{value}"));
    }
    for row in figures.assets_table.iter().flatten() {
        line(format_args!(
            "asset\t{}\t{} instances\t{} other scenes\t{} triangles\t{} bytes\t{}",
            row.asset,
            row.instances,
            row.other_scenes.len(),
            row.source_triangles,
            row.pack_bytes,
            row.name,
        ));
    }
    for warning in &figures.warnings {
        line(format_args!("warning\t{warning}"));
    }
    Ok(())
}

async fn figures(library: &Library, name: &str, table: bool) -> Result<SceneFigures, LibraryError> {
    let reference = library.reference(name).await?;
    let scene = library.scene(&reference.scene).await?;
    let assets = assets(library, unique(&scene)).await?;
    let assets_table = match table {
        true => Some(asset_rows(library, name, &scene, &assets).await?),
        false => None,
    };
    let sum = |of: fn(&Asset) -> u64| assets.values().map(of).sum();
    Ok(SceneFigures {
        name: name.to_owned(),
        scene: reference.scene,
        published_secs: reference.published_secs,
        assets: assets.len() as u64,
        instances: scene.instances.len() as u64,
        materials: scene.materials.len() as u64,
        textures: scene.textures.len() as u64,
        source_triangles: scene.source_triangles,
        dag_triangles: sum(|asset| asset.dag_triangles),
        clusters: sum(|asset| asset.clusters),
        levels: assets.values().map(|asset| asset.levels).max().unwrap_or(0),
        pages: sum(|asset| asset.pages.len() as u64),
        pack_bytes: sum(|asset| asset.pack_bytes()),
        texture_bytes: scene.textures.iter().map(|texture| texture.bytes).sum(),
        warnings: scene.warnings,
        assets_table,
    })
}

/// Each asset once, under the name of its first use, in the order of the scene.
async fn asset_rows(
    library: &Library,
    name: &str,
    scene: &Scene,
    assets: &BTreeMap<ContentHash, Asset>,
) -> Result<Vec<AssetRow>, LibraryError> {
    let scenes = all_scenes(library).await?;
    let users = users(&scenes);
    let mut instances = BTreeMap::<ContentHash, u64>::new();
    for instance in &scene.instances {
        let used = &scene.assets[instance.asset as usize];
        *instances.entry(used.asset).or_default() += 1;
    }
    let mut told = BTreeSet::new();
    let once = scene.assets.iter().filter(|used| told.insert(used.asset));
    let rows = once.map(|used| AssetRow {
        asset: used.asset,
        name: used.name.clone(),
        instances: instances.get(&used.asset).copied().unwrap_or(0),
        other_scenes: users
            .get(&used.asset)
            .into_iter()
            .flatten()
            .filter(|user| **user != name)
            .map(|user| (*user).to_owned())
            .collect(),
        source_triangles: assets[&used.asset].source_triangles,
        pack_bytes: assets[&used.asset].pack_bytes(),
    });
    Ok(rows.collect())
}
