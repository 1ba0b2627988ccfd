//! The rival: clusterlod of meshoptimizer 1.3 (Kapoulkine, <https://github.com/zeux/meshoptimizer>, `demo/clusterlod.h`),
//! fed as its demo feeds it: normals weighed by one half, texture seams protected, one index space without materials.

use lodestream_server::import::Mesh;
use meshopt::{ClodCluster, ClodConfig, ClodGroup, ClodMesh, VertexDataAdapter};

use super::dag::{ClusterDag, DagCluster, DagGroup, source_places};

/// The demo's weight of a normal's component.
const NORMAL_WEIGHT: f32 = 0.5;
/// Triangles of a cluster at most, as ours.
const CLUSTER_TRIANGLES: usize = 128;

/// Which of clusterlod's settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// `clodDefaultConfig`: clusters by adjacency.
    Default,
    /// `clodDefaultConfigRT`: clusters by place, more vertices.
    Spatial,
}

impl Preset {
    fn config(self) -> ClodConfig {
        match self {
            Self::Default => meshopt::clod_default_config(CLUSTER_TRIANGLES),
            Self::Spatial => meshopt::clod_default_config_rt(CLUSTER_TRIANGLES),
        }
    }
}

/// A mesh as clusterlod wants it. Made outside the measured time, since a caller may hold its vertices so.
pub struct Prepared<'a> {
    mesh: &'a Mesh,
    /// Normal, then texture coordinates, a vertex.
    attributes: Vec<f32>,
    floats: usize,
    weights: Vec<f32>,
    protect_mask: u32,
}

impl<'a> Prepared<'a> {
    /// Interleaves the attributes. Panics where a triangle names a vertex that is not there, or an array is short:
    /// unchecked foreign code reads them.
    pub fn new(mesh: &'a Mesh) -> Self {
        let vertices = mesh.positions.len();
        let largest = mesh.triangles.as_flattened().iter().max();
        assert!(largest.is_none_or(|&vertex| (vertex as usize) < vertices));
        let mut floats = 0;
        let (mut weights, mut protect_mask) = (Vec::new(), 0);
        if mesh.normals.is_some() {
            weights = vec![NORMAL_WEIGHT; 3];
            floats += 3;
        }
        if mesh.uvs.is_some() {
            protect_mask = 0b11 << floats;
            floats += 2;
        }
        let mut attributes = Vec::with_capacity(vertices * floats);
        for vertex in 0..vertices {
            attributes.extend(mesh.normals.iter().flat_map(|all| all[vertex]));
            attributes.extend(mesh.uvs.iter().flat_map(|all| all[vertex]));
        }
        Self {
            mesh,
            attributes,
            floats,
            weights,
            protect_mask,
        }
    }

    /// Runs clusterlod on this thread; `output` sees each group once, and is the only thing beside the build that the time holds.
    pub fn build(&self, preset: Preset, mut output: impl FnMut(ClodGroup, &[ClodCluster])) {
        let positions = meshopt::typed_to_bytes(&self.mesh.positions);
        let Ok(vertices) = VertexDataAdapter::new(positions, size_of::<[f32; 3]>(), 0) else {
            unreachable!("twelve bytes a position")
        };
        let indices = self.mesh.triangles.as_flattened();
        let mesh = ClodMesh {
            vertex_attributes: &self.attributes,
            vertex_attributes_stride: self.floats * size_of::<f32>(),
            attribute_weights: &self.weights,
            attribute_protect_mask: self.protect_mask,
            ..ClodMesh::new(indices, &vertices)
        };
        let mut groups = 0;
        meshopt::clod_build(preset.config(), &mesh, |group, clusters| {
            output(group, clusters);
            groups += 1;
            groups - 1
        });
    }

    /// Builds once more and keeps everything, over the places of [`source_places`].
    pub fn dag(&self, preset: Preset, center_metres: [f64; 3]) -> ClusterDag {
        let (places, source) = source_places(self.mesh, center_metres);
        let mut place_of = vec![0; self.mesh.positions.len()];
        for (corners, places) in self.mesh.triangles.iter().zip(&source) {
            for (&vertex, &place) in corners.iter().zip(places) {
                place_of[vertex as usize] = place;
            }
        }
        let mut dag = ClusterDag {
            places,
            ..ClusterDag::default()
        };
        self.build(preset, |group, clusters| {
            let index = dag.groups.len() as u32;
            for cluster in clusters {
                let triples = cluster.indices.as_chunks::<3>().0.iter();
                dag.push(
                    triples.map(|corners| corners.map(|vertex| place_of[vertex as usize])),
                    DagCluster {
                        first: 0,
                        count: 0,
                        vertices: cluster.vertex_count as u32,
                        level: group.depth as u32,
                        group: index,
                        child_group: u32::try_from(cluster.refined).ok(),
                    },
                );
            }
            let error = f64::from(group.simplified.error);
            dag.groups.push(DagGroup {
                parent_error_metres: match group.simplified.error == f32::MAX {
                    true => f64::INFINITY,
                    false => error,
                },
                level: group.depth as u32,
                members: Vec::new(),
                replacement: Vec::new(),
            });
        });
        dag.link();
        dag
    }
}
