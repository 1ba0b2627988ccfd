//! What pages cost: stored bytes over position steps and placements, part by part, beside the same mesh without levels.

mod whole_mesh;

use std::collections::BTreeMap;

use lodestream_format::cluster::Attributes;
use lodestream_format::disk_form::{DiskForm, Part, header_word};
use lodestream_format::limits::PAGE_WORDS;
use lodestream_format::{FormatError, frame};
use lodestream_server::build::{BuildOptions, BuiltAsset, Placement, PositionStep, build};
use lodestream_server::import::Mesh;
use serde::Serialize;

use crate::build::target::{MeshesOf, StudyError};

/// Height of the picture that a mesh fills when errors are given in pixels.
const PICTURE_PX: f64 = 1000.0;

/// Step of the position grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// The builder's choice.
    Auto,
    /// The finest power of two of which the largest side of a mesh has at most `2^bits`.
    Bits(u32),
}

impl std::str::FromStr for Step {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            text => match text.parse() {
                Ok(bits @ 8..=22) => Ok(Self::Bits(bits)),
                _ => Err(format!("expected auto or 8 to 22, found {text:?}")),
            },
        }
    }
}

/// What to measure.
#[derive(Debug, Clone)]
pub struct PagesOptions {
    /// The inputs.
    pub inputs: Vec<MeshesOf>,
    /// Steps of the position grid.
    pub steps: Vec<Step>,
    /// Where vertices of coarser levels lie.
    pub placements: Vec<Placement>,
}

/// All meshes of an input, with one step and one placement. Bytes over triangles unless said otherwise.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Row {
    /// The input.
    pub input: String,
    /// Bits of a position that were asked for; `null`: the builder's choice.
    pub bits: Option<u32>,
    /// Where vertices of coarser levels lie.
    pub placement: &'static str,
    /// Half a step's diagonal, where the mesh's largest side is 1000 pixels; the largest mesh's.
    pub error_px: f64,
    /// Triangles of level 0.
    pub source_triangles: u64,
    /// Triangles of all levels.
    pub dag_triangles: u64,
    /// Everything that is stored, over triangles of level 0.
    pub stored_per_input: f64,
    /// The same over triangles of all levels.
    pub stored_per_dag: f64,
    /// Level 0 as one mesh on the same grids, by meshoptimizer's codecs and zstd, over its triangles.
    pub whole_mesh_per_input: f64,
    /// Memory form over triangles of all levels.
    pub memory_per_dag: f64,
    /// Mean share of a page's bytes that is empty, of pages that others follow.
    pub slack: Option<f64>,
    /// Vertices of all clusters over their triangles.
    pub vertices_per_triangle: f64,
    /// Share of the vertices that is stored.
    pub own_share: f64,
    /// Share that other clusters of the page have.
    pub repeated_share: f64,
    /// Share that parents have.
    pub inherited_share: f64,
    /// Bits of each part over triangles of all levels.
    #[serde(flatten)]
    pub parts: Parts,
    /// Meshes that were refused.
    pub refused: u64,
}

/// Bits over triangles of all levels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Parts {
    /// Which triangles there are.
    pub topology_bits: f64,
    /// Where vertices come from that are not stored again.
    pub references_bits: f64,
    /// Positions.
    pub positions_bits: f64,
    /// Normals.
    pub normals_bits: f64,
    /// Texture coordinates.
    pub uvs_bits: f64,
    /// Colours.
    pub colors_bits: f64,
    /// Cluster headers and material tables.
    pub metadata_bits: f64,
    /// Hierarchy and list of pages.
    pub hierarchy_bits: f64,
}

/// Measures all inputs; `each` hears of every row before it starts.
///
/// # Errors
/// The first input that cannot be read; a built page that breaks the format.
pub fn study(options: &PagesOptions, mut each: impl FnMut(&str)) -> Result<Vec<Row>, StudyError> {
    let mut rows = Vec::new();
    for input in &options.inputs {
        let meshes = input.load()?;
        let name = input.short_name();
        each(&name);
        for &placement in &options.placements {
            for &step in &options.steps {
                let row = row(&name, &meshes, step, placement);
                rows.push(row.map_err(|source| StudyError::Format {
                    input: name.clone(),
                    source,
                })?);
            }
        }
    }
    Ok(rows)
}

/// What the meshes of a row add up to.
#[derive(Default)]
struct Sums {
    source_triangles: u64,
    dag_triangles: u64,
    whole_mesh: u64,
    stored: u64,
    memory: u64,
    /// Of pages that others follow: how many, and their words.
    full: [u64; 2],
    vertices: u64,
    repeated: u64,
    inherited: u64,
    parts: BTreeMap<Part, u64>,
    hierarchy: u64,
}

fn row(input: &str, meshes: &[Mesh], step: Step, placement: Placement) -> Result<Row, FormatError> {
    let mut sums = Sums::default();
    let mut row = Row {
        input: input.into(),
        bits: match step {
            Step::Auto => None,
            Step::Bits(bits) => Some(bits),
        },
        placement: match placement {
            Placement::Optimal => "optimal",
            Placement::Subset => "subset",
        },
        ..Row::default()
    };
    for mesh in meshes {
        let extent = extent_metres(mesh);
        let options = BuildOptions {
            position_step: match step {
                Step::Bits(bits) if extent > 0.0 => {
                    let step = extent / f64::from(1u32 << bits);
                    PositionStep::Metres(step.log2().ceil().exp2())
                }
                _ => PositionStep::Auto,
            },
            placement,
            ..BuildOptions::default()
        };
        let Ok(built) = build(mesh, &options) else {
            row.refused += 1;
            continue;
        };
        // The largest comes first.
        if row.error_px == 0.0 && extent > 0.0 {
            let step = built.asset.position_grid.step();
            row.error_px = 0.75f64.sqrt() * step / extent * PICTURE_PX;
        }
        sums.add(&built)?;
        sums.whole_mesh += whole_mesh::bytes(&built)?;
    }
    let (input, dag) = (sums.source_triangles as f64, sums.dag_triangles as f64);
    let vertices = sums.vertices as f64;
    let bits = |part: Part| 8.0 * sums.parts.get(&part).copied().unwrap_or(0) as f64 / dag;
    Ok(Row {
        source_triangles: sums.source_triangles,
        dag_triangles: sums.dag_triangles,
        stored_per_input: sums.stored as f64 / input,
        stored_per_dag: sums.stored as f64 / dag,
        whole_mesh_per_input: sums.whole_mesh as f64 / input,
        memory_per_dag: sums.memory as f64 / dag,
        slack: match sums.full {
            [0, _] => None,
            [pages, words] => Some(1.0 - words as f64 / (pages * PAGE_WORDS as u64) as f64),
        },
        vertices_per_triangle: vertices / dag,
        own_share: 1.0 - (sums.repeated + sums.inherited) as f64 / vertices,
        repeated_share: sums.repeated as f64 / vertices,
        inherited_share: sums.inherited as f64 / vertices,
        parts: Parts {
            topology_bits: bits(Part::Topology),
            references_bits: bits(Part::References),
            positions_bits: bits(Part::Positions),
            normals_bits: bits(Part::Normals),
            uvs_bits: bits(Part::Uvs),
            colors_bits: bits(Part::Colors),
            metadata_bits: bits(Part::Metadata),
            hierarchy_bits: 8.0 * sums.hierarchy as f64 / dag,
        },
        ..row
    })
}

fn extent_metres(mesh: &Mesh) -> f64 {
    let sides = (0..3).map(|axis| {
        let along = mesh
            .positions
            .iter()
            .map(|position| f64::from(position[axis]));
        let (low, high) = along.fold((f64::MAX, f64::MIN), |(low, high), value| {
            (low.min(value), high.max(value))
        });
        high - low
    });
    sides.fold(0.0, f64::max)
}

impl Sums {
    fn add(&mut self, built: &BuiltAsset) -> Result<(), FormatError> {
        let asset = &built.asset;
        self.source_triangles += asset.source_triangles;
        self.dag_triangles += asset.dag_triangles;
        self.hierarchy += (built.hierarchy_bytes.len() + built.asset_bytes.len()) as u64;
        self.stored +=
            asset.pack_bytes() + (built.hierarchy_bytes.len() + built.asset_bytes.len()) as u64;
        let last = asset.pages.len() - 1;
        for (page, entry) in asset.pages.iter().enumerate() {
            let unreadable = |cause| FormatError::new("page frame", "inside the pack", cause);
            let range = entry.offset..entry.offset + u64::from(entry.bytes);
            let words = frame::decode(&built.pack.read(range).map_err(unreadable)?)?;
            for (part, bytes) in frame::section_bytes(&words)? {
                *self.parts.entry(part).or_default() += bytes as u64;
            }
            let form = DiskForm::parse(words)?;
            let count = |word: usize| u64::from(form.words()[word]);
            self.vertices += count(header_word::VERTEX_COUNT);
            self.repeated += count(header_word::REPEATED);
            self.inherited += count(header_word::INHERITED);
            self.memory += 4 * form.memory_words() as u64;
            if page >= asset.root_page_count as usize && page < last {
                self.full[0] += 1;
                self.full[1] += form.memory_words() as u64;
            }
        }
        Ok(())
    }
}

/// Whether an asset has an attribute.
fn has(built: &BuiltAsset, flag: u32) -> bool {
    let attributes: Attributes = built.asset.attributes;
    attributes.has(flag)
}
