use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};
use proptest::prelude::*;

use super::*;

/// The triangles of a polygon, cut or as a fan.
fn triangles(corners: &[DVec3], cutter: &mut Cutter) -> Vec<[u32; 3]> {
    let fan = || (1..corners.len() as u32 - 1).map(|at| [0, at, at + 1]);
    let cut = cutter.cut(corners).unwrap_or_else(|| fan().collect());
    assert_eq!(cut.len(), corners.len() - 2);
    cut
}

/// Sum of the areas of triangles, each counted as positive.
fn area(corners: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let area = |it: &[u32; 3]| {
        let [a, b, c] = it.map(|at| corners[at as usize]);
        (b - a).cross(c - a).length() / 2.0
    };
    triangles.iter().map(area).sum()
}

fn flat(points: &[[f64; 2]]) -> Vec<DVec3> {
    points.iter().map(|&[x, y]| DVec3::new(x, y, 0.0)).collect()
}

/// The area enclosed by `corners`, which lie in a plane.
fn enclosed(corners: &[DVec3]) -> f64 {
    let local: Vec<DVec3> = corners.iter().map(|&it| it - corners[0]).collect();
    newell(&local).0.length() / 2.0
}

/// Turned around, tilted, and far away: the area is the same, and no warning is due.
fn covers(corners: &[DVec3], expected: f64) {
    let tilt = DMat3::from_rotation_x(1.1) * DMat3::from_rotation_y(0.7);
    let far = DVec3::new(456_789.125, -5_428_123.5, 12.25);
    let reversed: Vec<DVec3> = corners.iter().rev().copied().collect();
    let tilted: Vec<DVec3> = corners.iter().map(|&it| tilt * it + far).collect();
    for (corners, precision) in [(corners, 1e-12), (&reversed, 1e-12), (&tilted, 1e-8)] {
        for start in 0..corners.len().min(20) {
            let mut corners = corners.to_vec();
            corners.rotate_left(start);
            let mut cutter = Cutter::default();
            let found = area(&corners, &triangles(&corners, &mut cutter));
            let off = (found - expected).abs();
            assert!(off <= precision * expected, "{start}: {found}, {expected}");
            assert_eq!((cutter.crossing, cutter.too_winding), (0, 0), "{start}");
        }
    }
}

#[test]
fn concave_polygons_have_their_area() {
    // An arrow, a comb, a plus.
    covers(&flat(&[[0., 0.], [4., 2.], [0., 4.], [1., 2.]]), 6.0);
    let comb = [
        [0., 0.],
        [9., 0.],
        [9., 5.],
        [8., 5.],
        [8., 1.],
        [5., 1.],
        [5., 5.],
        [4., 5.],
        [4., 1.],
        [1., 1.],
        [1., 5.],
        [0., 5.],
    ];
    covers(&flat(&comb), 9.0 + 3.0 * 4.0);
    let plus = [
        [1., 0.],
        [2., 0.],
        [2., 1.],
        [3., 1.],
        [3., 2.],
        [2., 2.],
        [2., 3.],
        [1., 3.],
        [1., 2.],
        [0., 2.],
        [0., 1.],
        [1., 1.],
    ];
    covers(&flat(&plus), 5.0);
}

#[test]
fn straight_repeated_and_reversing_corners_lose_no_area() {
    // Corners on straight sides.
    let mut corners = flat(&[
        [0., 0.],
        [1., 0.],
        [2., 0.],
        [2., 1.],
        [1., 1.],
        [1., 2.],
        [0., 2.],
    ]);
    corners.insert(6, DVec3::new(0.5, 2.0, 0.0));
    covers(&corners, 3.0);
    // Each corner twice.
    let twice: Vec<DVec3> = corners.iter().flat_map(|&it| [it, it]).collect();
    covers(&twice, 3.0);
    // A spike out of a side and back, and one into the polygon.
    for tip in [[3., 1.5], [0.5, 1.5]] {
        let mut spiked = flat(&[
            [0., 0.],
            [2., 0.],
            [2., 1.5],
            tip,
            [2., 1.5],
            [2., 3.],
            [0., 3.],
        ]);
        covers(&spiked, 6.0);
        spiked.insert(4, DVec3::new(tip[0], tip[1], 0.0));
        covers(&spiked, 6.0);
    }
}

#[test]
fn bridges_to_holes_leave_them_open() {
    // Two holes, each reached and left by the same side.
    let corners = [
        [0., 0.],
        [1., 1.],
        [1., 2.],
        [2., 2.],
        [2., 1.],
        [1., 1.],
        [0., 0.],
        [9., 0.],
        [8., 1.],
        [7., 1.],
        [7., 2.],
        [8., 2.],
        [8., 1.],
        [9., 0.],
        [9., 3.],
        [0., 3.],
    ];
    covers(&flat(&corners), 25.0);
    // Both holes at one corner.
    let corners = [
        [0., 0.],
        [2., 1.],
        [1., 1.],
        [1., 2.],
        [2., 2.],
        [2., 1.],
        [0., 0.],
        [5., 1.],
        [4., 1.],
        [4., 2.],
        [5., 2.],
        [5., 1.],
        [0., 0.],
        [9., 0.],
        [9., 3.],
        [0., 3.],
    ];
    covers(&flat(&corners), 25.0);
}

#[test]
fn fans_that_cover_their_polygon_stay() {
    let disc: Vec<DVec3> = (0..50)
        .map(|at| DVec2::from_angle(f64::from(at) / 50.0 * TAU).extend(0.0))
        .collect();
    let mut cutter = Cutter::default();
    assert_eq!(cutter.cut(&disc), None);
    // Rounded, so that corners on a straight side are a little off it.
    let sides = [
        [0., 0.],
        [0.1, 0.],
        [0.3, 0.],
        [0.7, 0.],
        [0.7, 0.7],
        [0.35, 0.7],
        [0., 0.7],
    ];
    let tilt = DMat3::from_rotation_x(0.3) * DMat3::from_rotation_z(0.4);
    let tilted: Vec<DVec3> = flat(&sides).iter().map(|&it| tilt * it).collect();
    assert_eq!(cutter.cut(&tilted), None);
    // The notch is seen from the first corner.
    let arrow = flat(&[[1., 2.], [0., 0.], [4., 2.], [0., 4.]]);
    assert_eq!(cutter.cut(&arrow), None);
    assert_eq!(cutter.crossing, 0);
}

#[test]
fn quads_out_of_their_plane_are_cut_along_the_inner_diagonal() {
    let quad = [[0., 0., 0.], [4., 2., 0.3], [0., 4., 0.], [1., 2., -0.2]];
    for start in 0..4 {
        let mut corners: Vec<DVec3> = quad.into_iter().map(DVec3::from).collect();
        corners.rotate_left(start);
        let mut cutter = Cutter::default();
        let cut = triangles(&corners, &mut cutter);
        // Both triangles have the notch.
        let notch = (7 - start as u32) % 4;
        assert!(cut.iter().all(|it| it.contains(&notch)), "{start}: {cut:?}");
        assert_eq!(cutter.crossing, 0);
    }
}

#[test]
fn polygons_that_cross_themselves_are_told() {
    let star = |points: u32, step: u32| -> Vec<DVec3> {
        let angle = |at: u32| f64::from(at * step % points) / f64::from(points) * TAU;
        (0..points)
            .map(|at| DVec2::from_angle(angle(at)).extend(0.0))
            .collect()
    };
    let crossing = [
        flat(&[[0., 0.], [1., 1.], [1., 0.], [0., 1.]]),
        flat(&[[0., 0.], [3., 3.], [3., 0.], [0., 1.]]),
        flat(&[[0., 0.], [4., 0.], [4., 4.], [2., -1.], [0., 4.]]),
        star(5, 2),
        star(7, 3),
    ];
    for corners in crossing {
        for start in 0..corners.len() {
            let mut corners = corners.clone();
            corners.rotate_left(start);
            let mut cutter = Cutter::default();
            triangles(&corners, &mut cutter);
            assert_eq!(cutter.crossing, 1, "{corners:?}");
        }
    }
    // A line crosses nothing.
    let mut cutter = Cutter::default();
    triangles(
        &flat(&[[0., 0.], [1., 0.], [2., 0.], [3., 0.]]),
        &mut cutter,
    );
    assert_eq!(cutter.crossing, 0);
}

/// Outlines as of maps: a circle whose radius wanders, `turns` times around in a spiral.
fn outline(count: usize, seed: u64) -> Vec<DVec3> {
    let mut state = seed;
    let mut random = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 40) as f64 / (1u64 << 24) as f64
    };
    let angle = |at: usize| DVec2::from_angle(at as f64 / count as f64 * TAU);
    (0..count)
        .map(|at| (angle(at) * (1.0 + random())).extend(0.0))
        .collect()
}

fn spiral(count: usize) -> Vec<DVec3> {
    let arm = |at: usize, out: f64| {
        let turn = at as f64 / count as f64 * 40.0;
        (DVec2::from_angle(turn) * (1.0 + turn + out)).extend(0.0)
    };
    let outer = (0..count).map(|at| arm(at, 2.0));
    outer
        .chain((0..count).rev().map(|at| arm(at, 0.0)))
        .collect()
}

#[test]
fn long_polygons_take_few_steps() {
    let comb = (0..6_000).flat_map(|at| {
        let x = f64::from(at);
        [[x, 100.0], [x + 0.5, 1.0]]
    });
    let comb: Vec<[f64; 2]> = comb.chain([[6_000.0, 0.0], [0.0, 0.0]]).collect();
    for corners in [outline(100_000, 1), spiral(50_000), flat(&comb)] {
        let local: Vec<DVec3> = corners.iter().map(|&it| it - corners[0]).collect();
        let (normal, _) = newell(&local);
        let mut cutter = Cutter::default();
        let cut = triangles(&corners, &mut cutter);
        let (found, expected) = (area(&corners, &cut), normal.length() / 2.0);
        assert!(
            (found - expected).abs() < 1e-9 * expected,
            "{found} {expected}"
        );
        assert_eq!(
            (cutter.crossing, cutter.too_winding),
            (0, 0),
            "{}",
            cut.len()
        );
    }
}

#[test]
fn entangled_and_endless_polygons_end() {
    let mut cutter = Cutter::default();
    let entangled: Vec<DVec3> = outline(8_000, 7)
        .chunks(2)
        .enumerate()
        .flat_map(|(at, it)| [it[0] * (at % 7) as f64, it[1].yxz()])
        .collect();
    triangles(&entangled, &mut cutter);
    assert_eq!(cutter.crossing + cutter.too_winding, 1);
    assert_eq!(cutter.cut(&vec![DVec3::ZERO; MOST_CORNERS + 1]), None);
    assert_eq!(cutter.too_long, 1);
    let infinite = [DVec3::ZERO, DVec3::X, DVec3::INFINITY, DVec3::NAN];
    assert_eq!(cutter.cut(&infinite), None);
}

use glam::Vec3Swizzles as _;

proptest! {
    /// Seen from its middle no corner hides another, so that the outline crosses nothing.
    #[test]
    fn outlines_have_their_area(radii in prop::collection::vec(0.01f64..1.0, 4..200)) {
        let angle = |at: usize| DVec2::from_angle(at as f64 / radii.len() as f64 * TAU);
        let corners: Vec<DVec3> = radii
            .iter()
            .enumerate()
            .map(|(at, radius)| (angle(at) * *radius).extend(0.0))
            .collect();
        covers(&corners, enclosed(&corners));
    }

    /// Any corners, on a small grid so that they meet: no panic, and two triangles fewer.
    #[test]
    fn any_corners_are_cut(points in prop::collection::vec((0i8..6, 0i8..6, 0i8..2), 4..40)) {
        let corner = |&(x, y, z): &(i8, i8, i8)| DVec3::new(x.into(), y.into(), z.into());
        let corners: Vec<DVec3> = points.iter().map(corner).collect();
        let mut cutter = Cutter::default();
        let cut = triangles(&corners, &mut cutter);
        prop_assert!(cut.iter().flatten().all(|&it| (it as usize) < corners.len()));
    }
}
