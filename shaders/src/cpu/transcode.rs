//! Twin of `wgsl/transcode.wgsl`: gathers each word of the memory form from the planes of the staged form.

use lodestream_format::disk_form::{DiskForm, FIELDS};
use lodestream_format::memory_form::{
    CLUSTER_HEADER_WORDS, ClusterHeader, MAGIC, PAGE_HEADER_WORDS, cluster_word, page_word,
};

/// Writes the memory form of a page.
pub fn transcode(form: &DiskForm) -> Vec<u32> {
    let mut words = vec![0; form.memory_words()];
    for cluster in 0..form.headers().len() {
        transcode_cluster(form, cluster, &mut words);
    }
    transcode_page(form, &mut words);
    words
}

fn transcode_cluster(form: &DiskForm, cluster: usize, words: &mut [u32]) {
    let (header, span) = (&form.headers()[cluster], &form.spans()[cluster]);
    let first_word = PAGE_HEADER_WORDS + cluster * CLUSTER_HEADER_WORDS;
    for word in 0..CLUSTER_HEADER_WORDS {
        words[first_word + word] = header_word(form, header, span.payload_word, word);
    }
    let payload_word = span.payload_word as usize;
    let index_words = header.index_words();
    for word in 0..index_words {
        words[payload_word + word] = index_word(form, span.first_triangle, header, word as u32);
    }
    let widths = header.field_bits(form.attributes());
    for word in 0..header.payload_words(form.attributes()) - index_words {
        words[payload_word + index_words + word] =
            vertex_word(form, span.first_vertex, header, &widths, word as u32);
    }
}

fn transcode_page(form: &DiskForm, words: &mut [u32]) {
    words[page_word::MAGIC] = MAGIC;
    words[page_word::CLUSTER_COUNT] = form.headers().len() as u32;
    words[page_word::WORDS] = form.memory_words() as u32;
    words[page_word::ATTRIBUTES] = form.attributes().0;
    words[page_word::PAGE] = form.page();
    words[page_word::TABLES] = form.memory_tables_word();
    let tables = &form.words()[form.layout().tables..];
    words[form.memory_tables_word() as usize..].copy_from_slice(tables);
}

fn header_word(form: &DiskForm, header: &ClusterHeader, payload_word: u32, word: usize) -> u32 {
    match word {
        cluster_word::PAYLOAD => payload_word,
        cluster_word::MATERIALS if header.has_material_table() => {
            header.0[word] + form.memory_tables_word()
        }
        _ => header.0[word],
    }
}

/// Word `word` of a cluster's triangle indices.
fn index_word(form: &DiskForm, first_triangle: u32, header: &ClusterHeader, word: u32) -> u32 {
    let layout = form.layout();
    let bits = header.index_bits();
    let start = word * 32;
    let indices = header.triangle_count() * 3;
    (start / bits..indices)
        .take_while(|index| index * bits < start + 32)
        .fold(0, |value, index| {
            let plane = layout.index_planes + (index % 3) as usize * layout.index_plane_words;
            value
                | placed(
                    plane_byte(form, plane, first_triangle + index / 3),
                    index * bits,
                    start,
                )
        })
}

/// Word `word` of a cluster's vertex records.
fn vertex_word(
    form: &DiskForm,
    first_vertex: u32,
    header: &ClusterHeader,
    widths: &[u32; FIELDS],
    word: u32,
) -> u32 {
    let vertex_bits = header.vertex_bits(form.attributes());
    let start = word * 32;
    let mut vertex = start / vertex_bits;
    let mut at = vertex * vertex_bits;
    let mut value = 0;
    while vertex < header.vertex_count() && at < start + 32 {
        for (field, &bits) in widths.iter().enumerate() {
            if bits > 0 && at + bits > start && at < start + 32 {
                let stored = field_value(form, field, bits, first_vertex + vertex);
                value |= placed(stored, at, start);
            }
            at += bits;
        }
        vertex += 1;
    }
    value
}

/// Value of a field of `bits` bits, from its bytes' planes.
fn field_value(form: &DiskForm, field: usize, bits: u32, index: u32) -> u32 {
    let layout = form.layout();
    let plane = layout.field_plane(field);
    (0..bits.div_ceil(8)).fold(0, |value, byte| {
        let plane = plane + byte as usize * layout.vertex_plane_words;
        value | plane_byte(form, plane, index) << (8 * byte)
    })
}

fn plane_byte(form: &DiskForm, plane: usize, index: u32) -> u32 {
    form.words()[plane + index as usize / 4] >> (8 * (index % 4)) & 0xff
}

/// The share of a field that begins at bit `at` in the word that begins at bit `start`; the two overlap.
fn placed(value: u32, at: u32, start: u32) -> u32 {
    if at >= start {
        value << (at - start)
    } else {
        value >> (start - at)
    }
}
