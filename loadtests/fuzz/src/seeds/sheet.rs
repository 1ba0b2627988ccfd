//! A bumpy sheet in every format that is imported.

use serde_json::json;

use super::Seeds;
use crate::targets::meshopt::glb;

/// Vertices and triangles of a sheet of `side` squares.
fn sheet(side: u32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let row = side + 1;
    let vertex = |it: u32| {
        let (x, z) = ((it % row) as f32, (it / row) as f32);
        [x, (x * 1.7).sin() + (z * 2.3).cos(), z]
    };
    let square = |it: u32| {
        let first = it / side * row + it % side;
        [
            [first, first + row, first + 1],
            [first + 1, first + row, first + row + 1],
        ]
    };
    let triangles = (0..side * side).flat_map(square);
    ((0..row * row).map(vertex).collect(), triangles.collect())
}

/// As an OBJ with texture coordinates and two materials.
pub fn obj(side: u32) -> String {
    let (vertices, triangles) = sheet(side);
    let mut text = String::from("mtllib m.mtl\no sheet\n");
    for [x, y, z] in &vertices {
        text += &format!(
            "v {x} {y} {z} 1 0.5 {}\nvt {} {}\n",
            (x * 3.0) % 1.0,
            x / 9.0,
            z / 9.0
        );
    }
    text += "vn 0 1 0\nusemtl red\ns 1\n";
    for (number, [a, b, c]) in triangles.iter().map(|it| it.map(|at| at + 1)).enumerate() {
        match number % 4 {
            0 => text += &format!("f {a}/{a} {b}/{b} {c}/{c}\n"),
            1 => text += &format!("f {a} {b} {c}\nusemtl two\n"),
            2 => text += &format!("f {a}/{a}/1 {b}/{b}/-1 {c}/{c}/1 # the third\n"),
            _ => text += &format!("f {a}//1 {b}//1 {c}//1 \\\n -1//1\ng part\n"),
        }
    }
    text
}

const MTL: &str = "newmtl red\nKd 0.8 0.1 0.1\nd 0.5\nPm 0.1\nPr 0.9\nKe 1 2 3\nmap_Kd -s 2 2 -o 0 1 -clamp on t.png\n\
    newmtl two\nTr 0.5\nillum 2\nNs 10\nKd spectral f.rfl\nmap_Kd missing name.jpg\n";

/// All files.
pub fn files(seeds: &Seeds) {
    seeds.add("obj", "sheet", &[obj(3).as_bytes(), b"\0", MTL.as_bytes()]);
    seeds.add(
        "obj",
        "plain",
        &[b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0 0.5\nf 1 2 -2 4\nl 1 2\np 1\n"],
    );
    let (vertices, triangles) = sheet(2);
    ply(seeds, &vertices, &triangles);
    stl(seeds, &vertices, &triangles);
    gltf(seeds, &vertices, &triangles);
    meshopt(seeds);
}

fn ply(seeds: &Seeds, vertices: &[[f32; 3]], triangles: &[[u32; 3]]) {
    let head = |format: &str| {
        let properties = "property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\n\
            property float nz\nproperty float s\nproperty float t\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n";
        let faces = "property list uchar int vertex_indices\nproperty list uchar float texcoord\n";
        let (vertices, triangles) = (vertices.len(), triangles.len());
        format!(
            "ply\nformat {format} 1.0\ncomment TextureFile t.png\nelement vertex {vertices}\n{properties}element face {triangles}\n{faces}end_header\n"
        )
    };
    let mut text = head("ascii");
    let mut little = head("binary_little_endian").into_bytes();
    let mut big = head("binary_big_endian").into_bytes();
    for &[x, y, z] in vertices {
        text += &format!("{x} {y} {z} 0 1 0 0.5 {z} 255 0 9\n");
        for number in [x, y, z, 0.0, 1.0, 0.0, 0.5, z] {
            little.extend(number.to_le_bytes());
            big.extend(number.to_be_bytes());
        }
        little.extend([255, 0, 9]);
        big.extend([255, 0, 9]);
    }
    for [a, b, c] in triangles {
        text += &format!("3 {a} {b} {c} 6 0 0 0 1 1 1\n");
        little.push(3);
        big.push(3);
        for corner in [a, b, c] {
            little.extend(corner.to_le_bytes());
            big.extend(corner.to_be_bytes());
        }
        little.extend([0]);
        big.extend([0]);
    }
    seeds.add("ply", "text", &[text.as_bytes()]);
    seeds.add("ply", "little", &[&little]);
    seeds.add("ply", "big", &[&big]);
    let strips = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
        element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n6 0 1 2 -1 1 2\n";
    seeds.add("ply", "strips", &[strips.as_bytes()]);
}

fn stl(seeds: &Seeds, vertices: &[[f32; 3]], triangles: &[[u32; 3]]) {
    let mut text = String::from("solid sheet\n");
    let mut binary = vec![b' '; 80];
    binary.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        text += "facet normal 0 1 0\nouter loop\n";
        binary.extend([0; 12]);
        for corner in triangle {
            let [x, y, z] = vertices[*corner as usize];
            text += &format!("vertex {x} {y} {z}\n");
            binary.extend([x, y, z].iter().flat_map(|it| it.to_le_bytes()));
        }
        text += "endloop\nendfacet\n";
        binary.extend([0; 2]);
    }
    text += "endsolid sheet\n";
    seeds.add("stl", "text", &[text.as_bytes()]);
    seeds.add("stl", "binary", &[&binary]);
}

fn gltf(seeds: &Seeds, vertices: &[[f32; 3]], triangles: &[[u32; 3]]) {
    let positions: Vec<u8> = vertices
        .iter()
        .flatten()
        .flat_map(|it| it.to_le_bytes())
        .collect();
    let indices: Vec<u8> = triangles.iter().flatten().map(|&it| it as u8).collect();
    let bin = [&positions[..], &indices].concat();
    let document = |uri: Option<&str>| {
        json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
            "extensionsUsed": ["KHR_texture_transform", "KHR_materials_unlit", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing"],
            "nodes": [{ "children": [1, 2], "rotation": [0, 0, 0, 1] }, { "mesh": 0, "scale": [1, 2, -1] },
                { "mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1] }],
            "meshes": [{ "primitives": [
                { "attributes": { "POSITION": 0, "NORMAL": 0, "COLOR_0": 0 }, "indices": 1, "material": 0 },
                { "attributes": { "POSITION": 2, "TEXCOORD_0": 3 }, "mode": 5 },
            ] }],
            "materials": [{ "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": true, "emissiveFactor": [1, 0, 0],
                "extensions": { "KHR_materials_unlit": {} }, "pbrMetallicRoughness": { "baseColorTexture": { "index": 0,
                "extensions": { "KHR_texture_transform": { "offset": [0, 1], "rotation": 0.5, "scale": [2, 2] } } } } }],
            "textures": [{ "source": 0, "sampler": 0 }], "samplers": [{ "wrapS": 33071, "magFilter": 9728 }],
            "images": [{ "uri": "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGNgYGAAAAAEAAH2FzhVAAAAAElFTkSuQmCC" }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": vertices.len(), "type": "VEC3" },
                { "bufferView": 1, "componentType": 5121, "count": 3 * triangles.len(), "type": "SCALAR" },
                { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "sparse": { "count": 1,
                    "indices": { "bufferView": 1, "componentType": 5121 }, "values": { "bufferView": 0 } } },
                { "bufferView": 0, "componentType": 5123, "normalized": true, "count": 4, "type": "VEC2" },
            ],
            "bufferViews": [{ "buffer": 0, "byteLength": positions.len() },
                { "buffer": 0, "byteOffset": positions.len(), "byteLength": indices.len() }],
            "buffers": [{ "byteLength": bin.len(), "uri": uri }],
        })
    };
    seeds.add("gltf", "binary", &[&glb(&document(None), &bin)]);
    let zeros = "A".repeat(bin.len().div_ceil(3) * 4);
    let uri = format!("data:application/octet-stream;base64,{zeros}");
    seeds.add(
        "gltf",
        "text",
        &[document(Some(&uri)).to_string().as_bytes()],
    );
    seeds.add(
        "gltf",
        "outside",
        &[document(Some("in.gltf")).to_string().as_bytes()],
    );
}

fn meshopt(seeds: &Seeds) {
    let (vertices, triangles) = sheet(3);
    let indices: Vec<u32> = triangles.into_iter().flatten().collect();
    let add = |mode: u8, filter: u8, stride: u8, count: usize, packed: &[u8]| {
        let [low, high] = (count as u16).to_le_bytes();
        let name = format!("{mode}-{filter}-{stride}");
        seeds.add(
            "meshopt",
            &name,
            &[&[mode, filter, stride, low, high], packed],
        );
    };
    let packed = meshopt::encode_index_buffer(&indices, vertices.len()).expect("encodes");
    add(1, 0, 2, indices.len(), &packed);
    add(1, 0, 4, indices.len(), &packed);
    let packed = meshopt::encode_index_sequence(&indices, vertices.len()).expect("encodes");
    add(2, 0, 4, indices.len(), &packed);
    let packed = meshopt::encode_vertex_buffer(&vertices).expect("encodes");
    add(0, 0, 12, vertices.len(), &packed);
    add(0, 3, 12, vertices.len(), &packed);
    let packed = meshopt::encode_vertex_buffer_level(&vertices, 3, Some(1)).expect("encodes");
    add(0, 1, 12, vertices.len(), &packed);
    let small: Vec<[u8; 4]> = (0..64).map(|it| [it, it / 2, 255 - it, 127]).collect();
    let packed = meshopt::encode_vertex_buffer(&small).expect("encodes");
    add(0, 1, 4, small.len(), &packed);
    add(0, 4, 4, small.len(), &packed);
    let wide: Vec<[u16; 4]> = (0..64).map(|it| [it, it * 9, 999, 3]).collect();
    let packed = meshopt::encode_vertex_buffer(&wide).expect("encodes");
    add(0, 2, 8, wide.len(), &packed);
    add(0, 4, 8, wide.len(), &packed);
}
