//! Complete normals: those of no length mended, those that a part of a mesh lacks made.

use std::ops::Range;

use super::normals;
use super::scene::Mesh;
use super::warnings::Warnings;

/// Sets the normals of `mesh`. `given` has one for every vertex, or none at all; one of no length stands for an unusable one.
/// Triangles in `bare` (ascending ranges) have none: theirs are made, and no vertex of theirs is one of the others'.
pub(super) fn complete(
    mesh: &mut Mesh,
    mut given: Vec<[f32; 3]>,
    bare: &[Range<usize>],
    place: &str,
    warnings: &mut Warnings,
) {
    if bare.is_empty() {
        let mended = normals::mend(&mesh.positions, &mesh.triangles, &mut given);
        note_mended(mended, place, warnings);
        mesh.normals = Some(given);
        return;
    }
    let all = std::mem::take(&mut mesh.triangles);
    if bare
        == [Range {
            start: 0,
            end: all.len(),
        }]
    {
        mesh.triangles = all;
        let made = normals::make(&mesh.positions, &mut mesh.triangles);
        normals::gather(mesh, &made.sources);
        mesh.normals = Some(made.normals);
        return;
    }
    let (mut without, mut with): (Vec<[u32; 3]>, Vec<[u32; 3]>) = Default::default();
    let mut from = 0;
    for range in bare {
        with.extend(&all[from..range.start]);
        without.extend(&all[range.clone()]);
        from = range.end;
    }
    with.extend(&all[from..]);
    let made = normals::make(&mesh.positions, &mut without);

    // The vertices with normals keep their order and come first; the made ones follow.
    let mut is_kept = vec![false; mesh.positions.len()];
    for &vertex in with.iter().flatten() {
        is_kept[vertex as usize] = true;
    }
    let mut number = vec![0; mesh.positions.len()];
    let mut sources = Vec::new();
    for vertex in (0..mesh.positions.len()).filter(|&vertex| is_kept[vertex]) {
        number[vertex] = sources.len() as u32;
        sources.push(vertex as u32);
    }
    let kept = sources.len() as u32;
    let mut all_normals: Vec<[f32; 3]> = sources.iter().map(|&it| given[it as usize]).collect();
    sources.extend(&made.sources);
    normals::gather(mesh, &sources);
    for corner in with.iter_mut().flatten() {
        *corner = number[*corner as usize];
    }
    let mended = normals::mend(&mesh.positions, &with, &mut all_normals);
    note_mended(mended, place, warnings);
    all_normals.extend(made.normals);
    mesh.normals = Some(all_normals);

    let (mut with, mut without) = (with.into_iter(), without.into_iter());
    mesh.triangles = all;
    let mut from = 0;
    for range in bare {
        replace(&mut mesh.triangles[from..range.start], &mut with, 0);
        replace(&mut mesh.triangles[range.clone()], &mut without, kept);
        from = range.end;
    }
    replace(&mut mesh.triangles[from..], &mut with, 0);
}

fn replace(to: &mut [[u32; 3]], from: &mut impl Iterator<Item = [u32; 3]>, base: u32) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = from.map(|corner| base + corner);
    }
}

fn note_mended(mended: u64, place: &str, warnings: &mut Warnings) {
    warnings.add("normals of no length made anew", mended, place);
}
