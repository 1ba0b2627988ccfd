//! What the GPU tests share: an adapter or a visible skip, procedural scenes through the real builder, and both sides of
//! the bus filled with the same pages.

#![allow(clippy::unwrap_used)] // A test's way to fail.
#![allow(dead_code)] // Every test file uses its part.

use std::collections::HashMap;
use std::sync::Arc;

use lodestream_client::gpu::{Gpu, PageUpload, Renderer, TextureUpload, instance};
use lodestream_format::disk_form::DiskForm;
use lodestream_format::instances::InstanceSteps;
use lodestream_format::scene::{
    AlphaMode, Instance, Material, MediaType, SceneAsset, Texture, TextureUse, Wrap,
};
use lodestream_format::{Asset, ContentHash, Hierarchy, Scene, frame};
use lodestream_server::build::{BuildOptions, BuiltAsset, build, decode_pages};
use lodestream_server::import::Mesh;
use lodestream_server::library::Library;
use lodestream_shaders::SceneArrays;
use lodestream_shaders::cpu::{self, Camera, build_textures, transcode};

/// The adapter, or `None` after a line that says so; with `REQUIRE_GPU=1` its absence fails the test.
pub fn gpu() -> Option<Gpu> {
    match Gpu::open(&instance(), None, None) {
        Ok((gpu, _)) => Some(gpu),
        Err(error) if std::env::var("REQUIRE_GPU").is_ok_and(|value| value == "1") => {
            panic!("REQUIRE_GPU=1: {error}")
        }
        Err(error) => {
            println!("SKIPPED: {error}");
            None
        }
    }
}

/// A scene through the builder, all its pages decoded.
pub struct TestScene {
    pub scene: Scene,
    pub assets: Vec<(Asset, Hierarchy)>,
    /// Pages of each asset.
    pub forms: Vec<Vec<DiskForm>>,
    pub arrays: Arc<SceneArrays>,
    built: Vec<BuiltAsset>,
    /// Image files of the scene's textures.
    images: Vec<Vec<u8>>,
}

impl TestScene {
    /// `scene.assets` gets the built assets' names; `images` become its textures.
    pub fn new(meshes: &[Mesh], mut scene: Scene, images: Vec<Vec<u8>>) -> Self {
        let built: Vec<_> = meshes
            .iter()
            .map(|mesh| build(mesh, &BuildOptions::default()).unwrap())
            .collect();
        let assets: Vec<_> = built
            .iter()
            .map(|built| {
                let pages = built.asset.pages.len() as u32;
                let hierarchy = Hierarchy::decode(&built.hierarchy_bytes, pages).unwrap();
                (built.asset.clone(), hierarchy)
            })
            .collect();
        for (used, built) in scene.assets.iter_mut().zip(&built) {
            used.asset = ContentHash::of(&built.asset_bytes);
        }
        scene.textures = images.iter().map(|png| texture(png)).collect();
        let arrays = SceneArrays::new(&scene, assets.iter().map(|(a, h)| (a, h)));
        Self {
            forms: built
                .iter()
                .map(|built| decode_pages(built).unwrap())
                .collect(),
            arrays: Arc::new(arrays),
            scene,
            assets,
            built,
            images,
        }
    }

    /// Puts everything into the library in `folder`, as an ingest does.
    pub fn publish(&self, folder: &std::path::Path, name: &str) {
        let runtime = tokio::runtime::Runtime::new().unwrap();
        runtime.block_on(async {
            let library = Library::open_or_create(folder.to_str().unwrap()).unwrap();
            let scene = self.scene.encode().unwrap();
            let built = self.built.iter();
            let pack = |built: &BuiltAsset| {
                let bytes = built.pack.read(0..built.asset.pack_bytes()).unwrap();
                bytes.into_owned()
            };
            let packs: Vec<Vec<u8>> = built.clone().map(pack).collect();
            let objects = built
                .flat_map(|built| [&built.asset_bytes, &built.hierarchy_bytes])
                .chain(&packs)
                .chain(&self.images)
                .chain([&scene]);
            for object in objects {
                library.put_object(object.clone().into(), 0).await.unwrap();
            }
            library
                .publish(name, ContentHash::of(&scene))
                .await
                .unwrap();
        });
    }

    /// The textures as the twins see them.
    pub fn twin_textures(&self) -> cpu::Textures {
        let decoded: Vec<_> = self
            .images
            .iter()
            .map(|png| {
                let image = image::load_from_memory(png).unwrap().into_rgba8();
                (image.width(), image.height(), image.into_raw())
            })
            .collect();
        build_textures(&decoded, usize::MAX).unwrap()
    }

    /// Where the first `share` of every asset's pages (at least the root pages) lie when packed end to end, and the words
    /// that they take. A prefix is closed under dependencies.
    pub fn places(&self, share: f64) -> (Vec<(u32, u32)>, u32) {
        let (mut places, mut word) = (Vec::new(), 0);
        for ((asset, _), record) in self.assets.iter().zip(&self.arrays.assets) {
            let pages = (asset.pages.len() as f64 * share) as u32;
            for page in 0..pages.max(asset.root_page_count) {
                places.push((record.page_base + page, word));
                word += asset.pages[page as usize].memory_words;
            }
        }
        (places, word)
    }

    /// Scene-wide number of the first page of a page's asset.
    pub fn base(&self, page: u32) -> u32 {
        let bases = &self.arrays.assets;
        let asset = bases.partition_point(|record| record.page_base <= page) - 1;
        bases[asset].page_base
    }

    pub fn form(&self, page: u32) -> &DiskForm {
        let bases = &self.arrays.assets;
        let asset = bases.partition_point(|record| record.page_base <= page) - 1;
        &self.forms[asset][(page - bases[asset].page_base) as usize]
    }

    /// A page in disk form, out of its frame.
    pub fn disk_words(&self, page: u32) -> Vec<u32> {
        let bases = &self.arrays.assets;
        let asset = bases.partition_point(|record| record.page_base <= page) - 1;
        let built = &self.built[asset];
        let entry = &built.asset.pages[(page - bases[asset].page_base) as usize];
        let range = entry.offset..entry.offset + u64::from(entry.bytes);
        frame::decode(&built.pack.read(range).unwrap()).unwrap()
    }

    /// The pool as the twins see it, and its page table.
    pub fn twin_pool(&self, share: f64) -> (Vec<u32>, Vec<u32>) {
        let (places, words) = self.places(share);
        let mut pool = vec![0; words as usize];
        let mut page_table = self.arrays.empty_page_table();
        for (page, word) in places {
            let base = self.base(page);
            let parent = |parent: u32| Some(&pool[page_table[(base + parent) as usize] as usize..]);
            let memory = transcode(self.form(page), parent).unwrap();
            pool[word as usize..][..memory.len()].copy_from_slice(&memory);
            page_table[page as usize] = word;
        }
        (pool, page_table)
    }

    /// A renderer with the same pages installed.
    pub fn renderer(&self, gpu: &Gpu, share: f64, size_px: [u32; 2]) -> Renderer {
        let (places, words) = self.places(share);
        let mut renderer = Renderer::new(gpu, self.arrays.clone(), words as u64, size_px).unwrap();
        let word_of: HashMap<u32, u32> = places.iter().copied().collect();
        let parents: Vec<Vec<u32>> = places
            .iter()
            .map(|&(page, _)| {
                let parents = self.form(page).parents().iter();
                parents
                    .map(|&[parent, _]| word_of[&(self.base(page) + parent)])
                    .collect()
            })
            .collect();
        let uploads: Vec<_> = places
            .iter()
            .zip(&parents)
            .map(|(&(page, pool_word), parents)| PageUpload {
                form: self.form(page),
                pool_word,
                parents,
            })
            .collect();
        renderer
            .apply([], &uploads, places.iter().copied())
            .unwrap();
        let textures = &self.scene.textures;
        if !textures.is_empty() {
            let admitted = vec![Ok(()); textures.len()];
            let materials = &self.arrays.materials;
            let mut upload =
                TextureUpload::new(gpu, textures, &admitted, materials, 1 << 30).unwrap();
            for (index, file) in self.images.iter().enumerate() {
                upload.put(index, file).unwrap();
            }
            let layout = upload.finish(&mut renderer).unwrap();
            assert_eq!(layout.notes, [""; 0]);
        }
        renderer
    }
}

/// A torus of `n` x `n` quads with bumps, seam and all; `radius` metres around, a third of that thick.
pub fn torus(name: &str, n: u32, radius: f32, slots: u32) -> Mesh {
    let mut mesh = Mesh {
        name: name.to_owned(),
        ..Mesh::default()
    };
    let (mut normals, mut uvs) = (Vec::new(), Vec::new());
    for row in 0..=n {
        for column in 0..=n {
            let (u, v) = (column as f32 / n as f32, row as f32 / n as f32);
            // The seam's two sides are the same points, so angles come from the wrapped number.
            let angle = |at: u32| (at % n) as f32 / n as f32 * std::f32::consts::TAU;
            let (a, b) = (angle(column), angle(row));
            let bump = 1.0 + 0.12 * (9.0 * a).sin() * (7.0 * b).cos();
            let tube = radius / 3.0 * bump;
            let ring = radius + tube * b.cos();
            mesh.positions
                .push([ring * a.cos(), tube * b.sin(), ring * a.sin()]);
            normals.push([b.cos() * a.cos(), b.sin(), b.cos() * a.sin()]);
            uvs.push([u * 4.0, v * 2.0]);
        }
    }
    let corner = |row: u32, column: u32| row * (n + 1) + column;
    for row in 0..n {
        for column in 0..n {
            let [a, b, c, d] = [
                corner(row, column),
                corner(row, column + 1),
                corner(row + 1, column),
                corner(row + 1, column + 1),
            ];
            mesh.triangles.extend([[a, c, b], [b, c, d]]);
            let slot = (column * slots / n) as u16;
            mesh.triangle_materials.extend([slot, slot]);
        }
    }
    mesh.normals = Some(normals);
    mesh.uvs = Some(uvs);
    mesh.material_slots = (0..slots).collect();
    mesh
}

/// A square sheet of `n` x `n` quads, waved; no texture coordinates.
pub fn sheet(n: u32, size: f32) -> Mesh {
    let mut mesh = Mesh {
        name: "sheet".to_owned(),
        material_slots: vec![0],
        ..Mesh::default()
    };
    for row in 0..=n {
        for column in 0..=n {
            let (x, z) = (column as f32 / n as f32 - 0.5, row as f32 / n as f32 - 0.5);
            let y = 0.02 * (40.0 * x).sin() * (31.0 * z).cos();
            mesh.positions.push([x * size, y * size, z * size]);
        }
    }
    mesh.normals = Some(vec![[0.0, 1.0, 0.0]; mesh.positions.len()]);
    for row in 0..n {
        for column in 0..n {
            let at = row * (n + 1) + column;
            mesh.triangles
                .extend([[at, at + n + 1, at + 1], [at + 1, at + n + 1, at + n + 2]]);
            mesh.triangle_materials.extend([0, 0]);
        }
    }
    mesh
}

pub fn material(base_color: [f32; 3], double_sided: bool) -> Material {
    Material {
        name: String::new(),
        base_color_factor: [base_color[0], base_color[1], base_color[2], 1.0],
        base_color: None,
        emissive_factor: [0.0; 3],
        metallic: 0.0,
        roughness: 0.6,
        alpha_mode: AlphaMode::Opaque,
        double_sided,
        unlit: false,
    }
}

pub fn textured(texture: u32, alpha_mode: AlphaMode) -> Material {
    Material {
        base_color: Some(TextureUse {
            texture,
            wrap: [Wrap::Repeat, Wrap::Mirror],
            nearest: false,
            uv_transform: TextureUse::IDENTITY,
        }),
        alpha_mode,
        ..material([1.0; 3], true)
    }
}

/// A map that scales by `scale`, turns about Y by `turn` radians and moves.
pub fn placed(asset: u32, scale: [f64; 3], turn: f64, to: [f64; 3]) -> Instance {
    let (sin, cos) = turn.sin_cos();
    Instance {
        asset,
        world_from_object: [
            [cos * scale[0], 0.0, sin * scale[2], to[0]],
            [0.0, scale[1], 0.0, to[1]],
            [-sin * scale[0], 0.0, cos * scale[2], to[2]],
        ],
    }
}

pub fn used(name: &str, materials: Vec<u32>) -> SceneAsset {
    SceneAsset {
        name: name.to_owned(),
        asset: ContentHash::of(&[]),
        materials,
        steps: InstanceSteps::default(),
    }
}

/// Two assets, five instances: one mirrored, one scaled unevenly, one far away.
pub fn plain_scene() -> TestScene {
    let meshes = [torus("torus", 160, 1.0, 3), sheet(96, 8.0)];
    let scene = Scene {
        assets: vec![used("torus", vec![0, 1, 2]), used("sheet", vec![3])],
        instances: vec![
            placed(0, [1.0; 3], 0.0, [0.0, 0.6, 0.0]),
            placed(0, [-0.5, 0.5, 0.5], 1.0, [-2.2, 0.3, 1.0]),
            placed(0, [0.4, 1.2, 0.4], 2.0, [2.2, 0.6, -0.5]),
            placed(0, [1.0; 3], 0.5, [6.0, 0.6, -18.0]),
            placed(1, [1.0; 3], 0.0, [0.0, -0.2, 0.0]),
        ],
        materials: vec![
            material([0.8, 0.3, 0.2], true),
            material([0.2, 0.6, 0.3], true),
            material([0.3, 0.4, 0.8], true),
            material([0.7, 0.7, 0.6], true),
        ],
        ..Scene::default()
    };
    TestScene::new(&meshes, scene, Vec::new())
}

/// A textured, a masked and a single-sided material over three instances.
pub fn textured_scene() -> TestScene {
    let meshes = [torus("torus", 96, 1.0, 3), sheet(48, 8.0)];
    let scene = Scene {
        assets: vec![used("torus", vec![0, 1, 2]), used("sheet", vec![2])],
        instances: vec![
            placed(0, [1.0; 3], 0.0, [0.0, 0.6, 0.0]),
            placed(0, [-0.5, 0.5, 0.5], 1.0, [-2.2, 0.3, 1.0]),
            placed(1, [1.0; 3], 0.0, [0.0, -0.2, 0.0]),
        ],
        materials: vec![
            textured(0, AlphaMode::Opaque),
            textured(1, AlphaMode::Mask { cutoff: 0.5 }),
            material([0.7, 0.7, 0.6], false),
        ],
        ..Scene::default()
    };
    TestScene::new(&meshes, scene, vec![checker(64, false), checker(32, true)])
}

/// A PNG of `n` x `n` coloured squares with a gradient; every other square clear where `holes`.
pub fn checker(n: u32, holes: bool) -> Vec<u8> {
    let mut image = image::RgbaImage::new(n, n);
    for (x, y, texel) in image.enumerate_pixels_mut() {
        let odd = (x * 4 / n + y * 4 / n) % 2 == 1;
        let alpha = if holes && odd { 0 } else { 255 };
        let ramp = (x * 255 / n) as u8;
        texel.0 = if odd {
            [240, ramp, 40, alpha]
        } else {
            [30, 90, ramp, alpha]
        };
    }
    let mut png = std::io::Cursor::new(Vec::new());
    image.write_to(&mut png, image::ImageFormat::Png).unwrap();
    png.into_inner()
}

fn texture(png: &[u8]) -> Texture {
    let image = image::load_from_memory(png).unwrap();
    Texture {
        object: ContentHash::of(png),
        bytes: png.len() as u64,
        media_type: MediaType::Png,
        width: image.width(),
        height: image.height(),
    }
}

pub fn look(eye: [f64; 3], target: [f64; 3], size_px: [u32; 2]) -> Camera {
    Camera {
        eye: eye.into(),
        target: target.into(),
        up: glam::DVec3::Y,
        fov_y_degrees: 50.0,
        size_px,
    }
}

/// Writes a picture where a person can look at it, and says where.
pub fn keep_picture(name: &str, size_px: [u32; 2], color: &[u32]) -> std::path::PathBuf {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    let file = folder.join(format!("{name}.png"));
    lodestream_client::picture::write_png(&file, size_px, color).unwrap();
    file
}
