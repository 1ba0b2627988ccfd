//! Culling: the hierarchy against brute force, and what every cut must be, whatever is resident.
#![allow(clippy::unwrap_used, reason = "a test's failure is its panic")]

mod dag;

use std::collections::BTreeSet;

use dag::{Dag, Fixture, Random, random_dag};
use glam::DVec3;
use lodestream_format::Hierarchy;
use lodestream_format::cluster::NO_GROUP;
use lodestream_server::build::{BuildOptions, build, unpack_pages};
use lodestream_server::import::Mesh;
use lodestream_shaders::cpu::{
    Camera, Capacities, Culled, cut, cut_brute, near_for_radius, requests_brute, requests_only,
};
use lodestream_shaders::types::{ClusterItem, View, view_flag};

/// How often the checks met what they are about: a test that never sees a mixed cut proves nothing.
#[derive(Debug, Default)]
struct Seen {
    frames: usize,
    outside_frustum: usize,
    coarse: usize,
    source: usize,
    kept_coarse_by_residency: usize,
    requests: usize,
}

/// A camera near one of the instances.
fn random_view(random: &mut Random, fixture: &Fixture) -> View {
    let instance = &fixture.arrays.instances[random.below(fixture.arrays.instances.len())];
    let middle = instance.world_from_local(DVec3::ZERO);
    let distance = 10f64.powf(random.range(-1.0, 2.5));
    let camera = Camera {
        eye: middle + random.vector(distance),
        target: middle + random.vector(10.0),
        up: DVec3::Y,
        fov_y_degrees: random.range(5.0, 120.0),
        size_px: [1 + random.below(2000) as u32, 1 + random.below(2000) as u32],
    };
    let pixel_error_px = 10f64.powf(random.range(-1.0, 2.5)) as f32;
    let near_metres = near_for_radius(10f64.powf(random.range(-2.0, 4.0)));
    camera
        .view(near_metres, pixel_error_px)
        .with_scene(&fixture.arrays, Capacities::UNBOUNDED)
}

fn sorted(mut items: Vec<ClusterItem>) -> Vec<ClusterItem> {
    items.sort();
    items
}

/// No plane excludes anything.
fn without_frustum(mut view: View) -> View {
    view.planes_in_rel = [[0.0, 0.0, 0.0, 1.0]; 5];
    view
}

fn check_frame(fixture: &Fixture, view: &View, random: &mut Random, seen: &mut Seen) {
    let Fixture {
        arrays,
        page_table,
        pool,
        ..
    } = fixture;
    let culled = cut(arrays, view, page_table, pool);
    let brute = cut_brute(arrays, view, page_table, pool);
    assert_eq!(
        sorted(culled.visible.clone()),
        sorted(brute),
        "hierarchy against brute force"
    );
    assert_eq!(culled.counters.visible_count as usize, culled.visible.len());
    assert_eq!(
        culled.counters.triangles_drawn,
        triangles(fixture, &culled.visible)
    );
    assert_eq!(
        culled.requests,
        requests_brute(arrays, view, &fixture.group_aabbs()),
        "requests against brute force"
    );
    assert_eq!(
        culled.requests,
        requests_only(arrays, view).0,
        "requests without pages"
    );

    let open = without_frustum(*view);
    let whole = cut(arrays, &open, page_table, pool);
    check_valid_cut(fixture, &whole, random);
    seen.frames += 1;
    seen.requests += culled.requests.len();
    seen.outside_frustum += whole.visible.len() - culled.visible.len();
    let source = whole
        .visible
        .iter()
        .filter(|item| cluster(fixture, item).level == 0)
        .count();
    seen.source += source;
    seen.coarse += whole.visible.len() - source;
    let missing = whole
        .requests
        .iter()
        .filter(|request| page_table[request.page as usize] == u32::MAX);
    seen.kept_coarse_by_residency += missing.count();
}

fn cluster<'a>(fixture: &'a Fixture, item: &ClusterItem) -> &'a lodestream_format::Cluster {
    let asset = fixture.arrays.instances[item.instance as usize].asset as usize;
    let page = item.page - fixture.arrays.assets[asset].page_base;
    &fixture.dags[asset].pages[page as usize][item.cluster as usize]
}

fn triangles(fixture: &Fixture, items: &[ClusterItem]) -> u32 {
    items
        .iter()
        .map(|item| cluster(fixture, item).triangles.len() as u32)
        .sum()
}

/// From every source cluster, up any way through what it was simplified to, exactly one cluster is drawn.
fn check_valid_cut(fixture: &Fixture, culled: &Culled, random: &mut Random) {
    let drawn: BTreeSet<(u32, u32, u32)> = culled
        .visible
        .iter()
        .map(|item| (item.instance, item.page, item.cluster))
        .collect();
    for (index, instance) in fixture.arrays.instances.iter().enumerate() {
        let dag = &fixture.dags[instance.asset as usize];
        let page_base = fixture.arrays.assets[instance.asset as usize].page_base;
        let mut produced = vec![Vec::new(); dag.hierarchy.groups.len()];
        for (page, number, cluster) in numbered(dag) {
            if cluster.child_group != NO_GROUP {
                produced[cluster.child_group as usize].push((page, number));
            }
        }
        for (page, number, leaf) in
            numbered(dag).filter(|(.., cluster)| cluster.child_group == NO_GROUP)
        {
            let (mut at, mut group, mut count) = ((page, number), leaf.group, 0);
            loop {
                count += drawn.contains(&(index as u32, page_base + at.0, at.1)) as u32;
                let above = &produced[group as usize];
                if above.is_empty() {
                    break;
                }
                at = above[random.below(above.len())];
                group = dag.pages[at.0 as usize][at.1 as usize].group;
            }
            assert_eq!(
                count, 1,
                "clusters drawn above cluster {number} of page {page} of instance {index}"
            );
        }
    }
}

fn numbered(dag: &Dag) -> impl Iterator<Item = (u32, u32, &lodestream_format::Cluster)> {
    dag.pages.iter().enumerate().flat_map(|(page, clusters)| {
        clusters
            .iter()
            .enumerate()
            .map(move |(number, cluster)| (page as u32, number as u32, cluster))
    })
}

fn check_reference(fixture: &Fixture, mut view: View) {
    view.flags = view_flag::REFERENCE;
    let culled = cut(&fixture.arrays, &view, &fixture.page_table, &fixture.pool);
    let mut all = Vec::new();
    for (index, instance) in fixture.arrays.instances.iter().enumerate() {
        let page_base = fixture.arrays.assets[instance.asset as usize].page_base;
        for (page, number, _) in numbered(&fixture.dags[instance.asset as usize])
            .filter(|(.., cluster)| cluster.level == 0)
        {
            let page = page_base + page;
            let page_word = fixture.page_table[page as usize];
            all.push(ClusterItem {
                instance: index as u32,
                page,
                cluster: number,
                page_word,
            });
        }
    }
    assert_eq!(sorted(culled.visible), sorted(all));
    assert_eq!(
        culled.counters.instances_drawn as usize,
        fixture.arrays.instances.len()
    );
}

fn check_fixture(fixture: &mut Fixture, random: &mut Random, seen: &mut Seen) {
    for share in [0.0, 0.5, 0.9, 1.0] {
        fixture.install(random, share);
        for _ in 0..3 {
            let view = random_view(random, fixture);
            check_frame(fixture, &view, random, seen);
        }
    }
    let view = random_view(random, fixture);
    check_reference(fixture, view);
}

fn assert_covered(seen: &Seen) {
    let counts = [
        seen.outside_frustum,
        seen.coarse,
        seen.source,
        seen.kept_coarse_by_residency,
        seen.requests,
    ];
    assert!(counts.iter().all(|&count| count > seen.frames), "{seen:?}");
}

#[test]
fn random_dags_cut_as_brute_force_says() {
    let mut seen = Seen::default();
    for seed in 0..150 {
        println!("seed {seed}");
        let mut random = Random(seed);
        let dags = (0..1 + random.below(3))
            .map(|_| random_dag(&mut random))
            .collect();
        let mut fixture = Fixture::new(&mut random, dags);
        check_fixture(&mut fixture, &mut random, &mut seen);
    }
    assert_covered(&seen);
}

/// A bumpy closed surface.
fn bumpy_sphere(rings: u32, sectors: u32) -> Mesh {
    let mut mesh = Mesh {
        name: "bumpy".into(),
        positions: vec![],
        normals: None,
        uvs: None,
        colors: None,
        triangles: vec![],
        triangle_materials: vec![],
        material_slots: vec![0],
    };
    for ring in 0..=rings {
        for sector in 0..sectors {
            let (theta, phi) = (
                std::f64::consts::PI * ring as f64 / rings as f64,
                std::f64::consts::TAU * sector as f64 / sectors as f64,
            );
            let radius = 5.0
                + 0.4 * (7.0 * phi).sin() * (5.0 * theta).sin()
                + 0.1 * (31.0 * phi).cos() * (29.0 * theta).sin();
            let point = DVec3::new(
                theta.sin() * phi.cos(),
                theta.cos(),
                theta.sin() * phi.sin(),
            ) * radius;
            mesh.positions.push(point.as_vec3().to_array());
        }
    }
    for ring in 0..rings {
        for sector in 0..sectors {
            let [a, b] = [sector, (sector + 1) % sectors].map(|sector| ring * sectors + sector);
            let [c, d] = [a + sectors, b + sectors];
            mesh.triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    mesh.normals = Some(
        mesh.positions
            .iter()
            .map(|&point| {
                DVec3::from(point.map(f64::from))
                    .normalize()
                    .as_vec3()
                    .to_array()
            })
            .collect(),
    );
    mesh.triangle_materials = vec![0; mesh.triangles.len()];
    mesh
}

#[test]
fn built_assets_cut_as_brute_force_says() {
    let built = build(bumpy_sphere(192, 256), &BuildOptions::default()).unwrap();
    let hierarchy =
        Hierarchy::decode(&built.hierarchy_bytes, built.asset.pages.len() as u32).unwrap();
    let pages = unpack_pages(&built).unwrap();
    let dag = Dag {
        asset: built.asset.clone(),
        hierarchy,
        pages,
    };
    // What the monotony of the projected error rests on.
    for (.., cluster) in numbered(&dag).filter(|(.., cluster)| cluster.child_group != NO_GROUP) {
        let [coarse, fine] =
            [cluster.group, cluster.child_group].map(|group| &dag.hierarchy.groups[group as usize]);
        assert!(
            coarse.level > fine.level && coarse.parent_error_metres >= fine.parent_error_metres
        );
        assert!(
            coarse.lod_sphere().contains(&fine.lod_sphere()),
            "{coarse:?} {fine:?}"
        );
    }
    let mut random = Random(7);
    let mut seen = Seen::default();
    let mut fixture = Fixture::new(&mut random, vec![dag]);
    for _ in 0..3 {
        check_fixture(&mut fixture, &mut random, &mut seen);
    }
    assert_covered(&seen);
}

#[test]
fn lists_stop_at_their_capacity_and_counts_do_not() {
    let mut random = Random(3);
    let dags = vec![random_dag(&mut random)];
    let mut fixture = Fixture::new(&mut random, dags);
    fixture.install(&mut random, 1.0);
    let mut view = random_view(&mut random, &fixture);
    view.flags = view_flag::REFERENCE;
    let full = cut(&fixture.arrays, &view, &fixture.page_table, &fixture.pool);
    assert!(full.visible.len() > 4 && full.requests.len() > 4 && full.counters.node_count_max > 1);

    view.cluster_capacity = 3;
    view.request_capacity = 2;
    let capped = cut(&fixture.arrays, &view, &fixture.page_table, &fixture.pool);
    assert_eq!(capped.candidates, full.candidates[..3]);
    assert_eq!(
        capped.counters.candidate_count,
        full.counters.candidate_count
    );
    assert_eq!(capped.requests, full.requests[..2]);
    assert_eq!(capped.counters.request_count, full.counters.request_count);
    assert_eq!(capped.args.clusters, [1, 1, 1]);

    let view = View {
        node_capacity: 1,
        ..view
    };
    let capped = cut(&fixture.arrays, &view, &fixture.page_table, &fixture.pool);
    assert_eq!(capped.counters.node_count.max(1), 1);
    assert!(
        capped.counters.node_count_max > 1,
        "the host sees what it would have taken"
    );
}

#[test]
fn an_empty_scene_draws_nothing() {
    let arrays = lodestream_shaders::SceneArrays::default();
    let camera = Camera::for_scene(&arrays, [64, 64]);
    let view = camera
        .view(0.05, 1.0)
        .with_scene(&arrays, Capacities::UNBOUNDED);
    let culled = cut(&arrays, &view, &[], &[]);
    assert!(culled.visible.is_empty() && culled.requests.is_empty());
    assert_eq!(culled.args.raster, [384, 0, 0, 0]);
}
