//! What holds of every built asset, whatever the mesh.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod build_support;

use build_support::cut::ReadAsset;
use build_support::meshes;
use lodestream_format::cluster::NO_GROUP;
use lodestream_format::limits::MAX_EXTENT_STEPS;
use lodestream_server::build::{BuildError, BuildOptions, BuiltAsset, PositionStep, build};
use lodestream_server::import::Mesh;

fn built(mesh: &Mesh) -> BuiltAsset {
    build(mesh, &BuildOptions::default()).unwrap()
}

/// Everything at once: format checks, monotone bounds, source kept at level 0, cuts.
fn check(mesh: &Mesh, pairs: usize) -> (BuiltAsset, ReadAsset) {
    let built = built(mesh);
    let read = ReadAsset::new(&built);
    read.check_monotone();
    check_source(mesh, &built, &read);
    let clusters = read.check_random_cuts(pairs, 1);
    let report = &built.report;
    println!(
        "{}: {} triangles, {} clusters ({:.1} a cluster), {} groups, {} levels, {} pages ({} root), root groups {}, moved {}, \
         {pairs} cuts, {clusters} clusters drawn",
        mesh.name,
        report.triangles,
        report.clusters,
        report.cluster_fill,
        report.groups,
        report.levels,
        report.pages,
        built.asset.root_page_count,
        roots(&read).count(),
        report.groups_with_moved_open_edges,
    );
    let moved = read
        .moved_edges()
        .iter()
        .filter(|sums| !sums.is_empty())
        .count();
    assert_eq!(moved as u64, report.groups_with_moved_open_edges);
    let terms = report.groups_by_term;
    let distances = terms.source + terms.surface + terms.members + terms.lost;
    let replaced = report.groups - roots(&read).count() as u64;
    assert_eq!(distances + terms.attributes + terms.materials, replaced);
    (built, read)
}

fn roots(read: &ReadAsset) -> impl Iterator<Item = &lodestream_format::hierarchy::Group> {
    read.hierarchy.groups.iter().filter(|group| group.is_root())
}

/// Level 0 holds just the source triangles, on the grid and with their materials, less those that collapsed.
fn check_source(mesh: &Mesh, built: &BuiltAsset, read: &ReadAsset) {
    let grid = built.asset.position_grid;
    let center = built.asset.center_q;
    let mut expected = Vec::new();
    for (triangle, &material) in mesh.triangles.iter().zip(&mesh.triangle_materials) {
        let corners = triangle.map(|index| {
            let position = mesh.positions[index as usize];
            let q: [i64; 3] =
                std::array::from_fn(|axis| grid.quantize(position[axis] as f64) - center[axis]);
            q
        });
        if corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0] {
            expected.push((turned(corners), material));
        }
    }
    let mut found = Vec::new();
    for cluster in read
        .clusters
        .iter()
        .filter(|cluster| cluster.child_group == NO_GROUP)
    {
        let slots = cluster
            .materials
            .iter()
            .flat_map(|range| std::iter::repeat_n(range.slot, range.triangle_count as usize));
        for (triangle, slot) in cluster.triangles.iter().zip(slots) {
            let corners = triangle.map(|index| cluster.positions[index as usize].map(i64::from));
            found.push((turned(corners), slot));
        }
    }
    if expected.is_empty() {
        assert_eq!(found.len(), 1, "one triangle stays where all collapse");
        return;
    }
    expected.sort_unstable();
    found.sort_unstable();
    assert!(expected == found, "level 0 is not the source");
}

fn turned([a, b, c]: [[i64; 3]; 3]) -> [[i64; 3]; 3] {
    [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap()
}

#[test]
fn closed_smooth_meshes_come_down_to_one_cluster() {
    for mesh in [meshes::sphere(40, 1.0, [0.0; 3]), meshes::torus(160, 80)] {
        let (built, read) = check(&mesh, 40);
        let root: Vec<_> = roots(&read).collect();
        assert_eq!(root.len(), 1);
        assert_eq!(root[0].cluster_count, 1);
        assert_eq!(built.report.groups_with_moved_open_edges, 0);
        assert!(built.report.dag_triangles < 24 * built.report.triangles / 10);
        assert!(read.source_sums().is_empty());
    }
}

/// A border of 400 edges comes down with the surface; where it lies is bounded like everything else (see the errors below).
#[test]
fn open_borders_simplify_with_the_surface() {
    let (built, read) = check(&meshes::terrain(100), 40);
    assert!(built.report.groups_with_moved_open_edges > 0);
    assert_eq!(read.source_sums().len(), 400);
    let root: Vec<_> = roots(&read).collect();
    assert_eq!((root.len(), root[0].cluster_count), (1, 1));
    // The coarsest cut still has one border round the square.
    let coarsest = read.drawn(&read.uniform_refinement(1e29));
    let border = read.sums_of(coarsest.into_iter());
    assert!(
        (4..200).contains(&border.len()),
        "{} border edges",
        border.len()
    );
}

#[test]
fn materials_and_seams_survive() {
    let mesh = meshes::two_material_box(40);
    let (built, read) = check(&mesh, 40);
    assert_eq!(built.report.groups_with_moved_open_edges, 0);
    // Every level keeps both materials, each with the area it had, but for what the errors allow.
    let area = |clusters: &[usize], slot: u16| {
        let mut sum = 0.0;
        for &cluster in clusters {
            let slots = read.clusters[cluster].materials.iter();
            let slots = slots
                .flat_map(|range| std::iter::repeat_n(range.slot, range.triangle_count as usize));
            for (corners, own) in read.corners[cluster].iter().zip(slots) {
                let [a, b, c] = corners.map(|place| glam::Vec3::from(read.places[place as usize]));
                sum += if own == slot {
                    0.5 * (b - a).cross(c - a).length()
                } else {
                    0.0
                };
            }
        }
        sum
    };
    let source = read.drawn(&vec![true; read.hierarchy.groups.len()]);
    // A cut whose error is a fifth of the box: what differs is at most a four-hundredth of a face.
    let coarse_cut = read.drawn(&read.uniform_refinement(0.2));
    for slot in [0, 1] {
        let (fine, coarse) = (area(&source, slot), area(&coarse_cut, slot));
        println!("slot {slot}: area {fine} at the source, {coarse} in the coarse cut");
        assert!((fine - coarse).abs() < 0.05 * fine);
    }
}

#[test]
fn loose_parts_and_unwelded_soup_get_coarser_too() {
    for mesh in [
        meshes::tetrahedra(2000),
        meshes::unwelded(&meshes::sphere(24, 1.0, [0.0; 3])),
        meshes::slivers(60),
    ] {
        let (_, read) = check(&mesh, 30);
        let left: u32 = roots(&read).map(|group| group.triangle_count).sum();
        assert!(
            left < 1000,
            "{}: {left} triangles in root groups",
            mesh.name
        );
    }
}

#[test]
fn thousands_of_sheets_get_coarser() {
    let (_, read) = check(&meshes::cards(6000), 30);
    let left: u32 = roots(&read).map(|group| group.triangle_count).sum();
    assert!(left <= 128, "{left} triangles in root groups");
}

#[test]
fn stored_error_bounds_the_distance_to_the_source() {
    for mesh in [
        meshes::sphere(24, 1.0, [0.0; 3]),
        meshes::torus(80, 40),
        meshes::terrain(50),
        meshes::two_material_box(24),
        meshes::tetrahedra(600),
        meshes::cards(3000),
        meshes::unwelded(&meshes::sphere(12, 1.0, [0.0; 3])),
    ] {
        let read = ReadAsset::new(&built(&mesh));
        for (stored, measured) in read.check_errors() {
            println!(
                "{}: stored {stored:.3e} m, measured {measured:.3e} m, ratio {:.2}",
                mesh.name,
                stored / measured
            );
        }
    }
}

#[test]
fn bytes_do_not_depend_on_the_thread_count() {
    for mesh in [
        meshes::torus(400, 120),
        meshes::two_material_box(30),
        meshes::cards(3000),
    ] {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| built(&mesh))
        };
        let (one, four, again) = (on(1), on(4), on(4));
        for other in [&four, &again] {
            assert_eq!(one.asset_bytes, other.asset_bytes);
            assert_eq!(one.hierarchy_bytes, other.hierarchy_bytes);
            assert_eq!(one.asset.pack, other.asset.pack);
        }
    }
}

#[test]
fn clusters_are_full() {
    for (mesh, least) in [
        // A group that its budget ends is no whole number of clusters.
        (meshes::torus(300, 120), 122.0),
        // Sheets of two triangles over four vertices: full by vertices, not by triangles.
        (meshes::cards(30_000), 84.0),
        (meshes::unwelded(&meshes::sphere(60, 1.0, [0.0; 3])), 118.0),
    ] {
        let report = built(&mesh).report;
        let fill = report.cluster_fill;
        assert!(fill >= least, "{}: {fill} triangles a cluster", mesh.name);
    }
}

#[test]
fn size_and_place_do_not_matter() {
    let unit = meshes::torus(120, 60);
    let reference = built(&unit);
    for exponent in [-20, 20] {
        let factor = 2f32.powi(exponent);
        let other = built(&meshes::mapped(&unit, "scaled", |x| x * factor));
        assert_eq!(
            other.asset.pack, reference.asset.pack,
            "the same grid indices and levels"
        );
        for (row, own) in reference
            .report
            .levels_table
            .iter()
            .zip(&other.report.levels_table)
        {
            assert_eq!(row.error_max * factor as f64, own.error_max);
        }
    }
    for (name, mesh) in [
        ("at 1e7", meshes::mapped(&unit, "far", |x| x + 1e7)),
        ("tiny", meshes::mapped(&unit, "tiny", |x| x * 1e-6)),
        ("huge", meshes::mapped(&unit, "huge", |x| x * 1e6)),
        (
            "a metre of f32 step",
            meshes::mapped(&meshes::sphere(20, 1e3, [0.0; 3]), "coarse", |x| x + 1e7),
        ),
    ] {
        println!("{name}");
        check(&mesh, 5);
    }
}

#[test]
fn the_smallest_and_the_worst_meshes_build() {
    let triangle =
        |corners: [[f32; 3]; 3]| meshes::plain("triangle", corners.into(), vec![[0, 1, 2]]);
    let (_, read) = check(&triangle([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), 2);
    assert_eq!(read.clusters.len(), 1);
    let two = meshes::plain(
        "two",
        vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
        vec![[0, 1, 2], [0, 2, 3]],
    );
    check(&two, 2);
    for place in [[0.0; 3], [1e7; 3], [-3e38; 3], [1e-40; 3]] {
        let (built, read) = check(&triangle([place; 3]), 2);
        assert_eq!(read.clusters[0].triangles.len(), 1);
        assert_eq!(built.report.warnings.len(), 1);
    }
    let collinear = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
    check(&triangle(collinear), 2);
    let mut all_twice = meshes::sphere(12, 1.0, [0.0; 3]);
    all_twice.triangles.extend(all_twice.triangles.clone());
    all_twice
        .triangle_materials
        .extend(all_twice.triangle_materials.clone());
    check(&all_twice, 5);
    check(&meshes::hub(100_000), 5);
    // Half the range of f32 at once.
    check(
        &triangle([[-1e36; 3], [1e36, 0.0, 0.0], [0.0, 1e36, 1.0]]),
        2,
    );
}

#[test]
fn what_cannot_be_built_is_refused_in_one_line() {
    let options = BuildOptions::default();
    let nothing = meshes::plain("nothing", vec![[0.0; 3]], Vec::new());
    assert!(matches!(
        build(&nothing, &options),
        Err(BuildError::NoTriangles { .. })
    ));
    let good = meshes::torus(8, 8);
    let spoil = |change: fn(&mut Mesh)| {
        let mut mesh = good.clone();
        change(&mut mesh);
        build(&mesh, &options).unwrap_err().to_string()
    };
    let lines = [
        spoil(|mesh| mesh.triangles[5][1] = 64),
        spoil(|mesh| mesh.positions[3][2] = f32::NAN),
        spoil(|mesh| mesh.triangle_materials[9] = 1),
        spoil(|mesh| mesh.normals = Some(Vec::new())),
        spoil(|mesh| mesh.uvs = Some(vec![[0.0, f32::INFINITY]; 64])),
        spoil(|mesh| mesh.positions[0] = [f32::MAX; 3]),
    ];
    for (line, part) in lines.iter().zip([
        "triangle 5",
        "position 3",
        "triangle 9",
        "normals",
        "uv 0",
        "extent",
    ]) {
        assert!(line.contains(part) && !line.contains('\n'), "{line}");
    }
    for found in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let options = BuildOptions {
            position_step: PositionStep::Metres(found),
            ..BuildOptions::default()
        };
        assert!(matches!(
            build(&good, &options),
            Err(BuildError::InvalidStep { .. })
        ));
    }
}

#[test]
fn the_position_step_is_kept_or_said_to_be_too_fine() {
    let mesh = meshes::torus(40, 20);
    let with = |metres: f64| {
        let step = PositionStep::Metres(metres);
        build(
            &mesh,
            &BuildOptions {
                position_step: step,
                ..BuildOptions::default()
            },
        )
        .unwrap()
    };
    assert_eq!(with(0.01).asset.position_grid.step(), 2f64.powi(-7));
    assert!(
        with(0.01)
            .report
            .warnings
            .iter()
            .all(|line| !line.contains("position step"))
    );
    let fine = with(1e-12);
    assert!(2.61 / fine.asset.position_grid.step() <= MAX_EXTENT_STEPS as f64);
    assert!(
        fine.report
            .warnings
            .iter()
            .any(|line| line.contains("position step"))
    );
    // Coarse enough, everything collapses, and something is still there.
    let coarse = with(100.0);
    assert_eq!(coarse.asset.clusters, 1);
    assert!(
        coarse
            .report
            .warnings
            .iter()
            .any(|line| line.contains("every triangle collapsed"))
    );
}

#[test]
fn pages_are_full_and_root_pages_small() {
    let (built, _) = check(&meshes::torus(500, 250), 3);
    let pages = &built.asset.pages;
    assert!(pages.len() > 5);
    assert!(
        4 * pages[0].memory_words as usize <= lodestream_format::limits::ROOT_PAGE_TARGET_BYTES
    );
    assert_eq!(built.asset.root_page_count, 1);
    // All but the first and the last hold no room for another cluster of usual size.
    for page in &pages[1..pages.len() - 1] {
        assert!(page.memory_words > 31 * 1024, "{} words", page.memory_words);
    }
    let small = built_pages(&meshes::torus(20, 10));
    assert_eq!(small, 1);
}

fn built_pages(mesh: &Mesh) -> usize {
    built(mesh).asset.pages.len()
}

/// The check of cuts is worth something: it fails for a cut with a cluster missing, one twice, or a group half refined.
#[test]
fn a_broken_cut_is_seen() {
    let read = ReadAsset::new(&built(&meshes::torus(120, 60)));
    let source = read.source_sums();
    let refine = read.uniform_refinement(1e-2);
    let drawn = read.drawn(&refine);
    assert_eq!(read.sums_of(drawn.iter().copied()), source);
    assert_ne!(read.sums_of(drawn[1..].iter().copied()), source);
    assert_ne!(
        read.sums_of(drawn.iter().chain(&drawn[..1]).copied()),
        source
    );
    // Refining a group whose replacement is not on screen, as with a page installed before what it depends on.
    let coarse = read.uniform_refinement(5e-2);
    let orphan = (0..coarse.len()).find(|&group| {
        let members = (0..read.clusters.len())
            .filter(|&cluster| read.clusters[cluster].group as usize == group);
        !coarse[group]
            && !read.sums_of(members).is_empty()
            && read.parents[group]
                .iter()
                .any(|&parent| !coarse[parent as usize])
    });
    let mut torn = coarse.clone();
    torn[orphan.unwrap()] = true;
    let moved = read.moved_edges();
    read.check_cut(&coarse, &source, &moved);
    let check = || read.check_cut(&torn, &source, &moved);
    assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(check)).is_err());
    assert_ne!(read.sums_of(read.drawn(&torn).into_iter()), source);
}
