//! The WGSL of a pass from its file, the files that it imports, and the pool's declarations.

use crate::passes::{Pass, PoolAccess, PoolBindings};
use crate::target::VisbufferTarget;

const SHARED: &[(&str, &str)] = &[
    ("types", include_str!("../wgsl/shared/types.wgsl")),
    ("view", include_str!("../wgsl/shared/view.wgsl")),
    ("scene", include_str!("../wgsl/shared/scene.wgsl")),
    (
        "error_metric",
        include_str!("../wgsl/shared/error_metric.wgsl"),
    ),
    ("refine", include_str!("../wgsl/shared/refine.wgsl")),
    ("proxy", include_str!("../wgsl/shared/proxy.wgsl")),
    ("snap", include_str!("../wgsl/shared/snap.wgsl")),
    (
        "raster_choice",
        include_str!("../wgsl/shared/raster_choice.wgsl"),
    ),
    ("hzb", include_str!("../wgsl/shared/hzb.wgsl")),
    ("occlusion", include_str!("../wgsl/shared/occlusion.wgsl")),
    (
        "hardware_list",
        include_str!("../wgsl/shared/hardware_list.wgsl"),
    ),
    (
        "node_queues",
        include_str!("../wgsl/shared/node_queues.wgsl"),
    ),
    ("visit", include_str!("../wgsl/shared/visit.wgsl")),
    (
        "memory_form",
        include_str!("../wgsl/shared/memory_form.wgsl"),
    ),
    ("strips", include_str!("../wgsl/shared/strips.wgsl")),
    (
        "staged_form",
        include_str!("../wgsl/shared/staged_form.wgsl"),
    ),
    ("cluster", include_str!("../wgsl/shared/cluster.wgsl")),
    (
        "fetch_vertex",
        include_str!("../wgsl/shared/fetch_vertex.wgsl"),
    ),
    (
        "sample_texture",
        include_str!("../wgsl/shared/sample_texture.wgsl"),
    ),
    ("material", include_str!("../wgsl/shared/material.wgsl")),
    ("srgb", include_str!("../wgsl/shared/srgb.wgsl")),
    (
        "barycentric",
        include_str!("../wgsl/shared/barycentric.wgsl"),
    ),
    ("surface", include_str!("../wgsl/shared/surface.wgsl")),
    ("light", include_str!("../wgsl/shared/light.wgsl")),
    ("hash", include_str!("../wgsl/shared/hash.wgsl")),
    (
        "false_color",
        include_str!("../wgsl/shared/false_color.wgsl"),
    ),
];

impl Pass {
    /// The whole WGSL module: every `#import NAME` line brings `wgsl/shared/NAME.wgsl` once, and the
    /// page pool's declarations follow.
    ///
    /// `#import visbuffer` brings the file of the target with 64-bit atomics.
    pub fn source(&self, pool: PoolBindings) -> String {
        self.source_for(pool, VisbufferTarget::U64)
    }

    /// [`Pass::source`], with `#import visbuffer` bringing the file of `target`. Compute passes
    /// have no attachments: beside those they write in two rounds.
    pub fn source_for(&self, pool: PoolBindings, target: VisbufferTarget) -> String {
        let target = match (target, self.entry_points) {
            (VisbufferTarget::Attachment, [_]) => VisbufferTarget::TwoRound,
            (target, _) => target,
        };
        let mut imported = Vec::new();
        let mut source = expand(self.file, target, &mut imported);
        source.push_str(&self.pool_source(pool));
        source
    }

    fn pool_source(&self, pool: PoolBindings) -> String {
        let (access, reads) = match self.pool {
            PoolAccess::None => return String::new(),
            PoolAccess::Read => ("read", true),
            PoolAccess::Write => ("read_write", false),
        };
        let mut source = String::from("\n");
        for index in 0..pool.count {
            let binding = self.bindings.len() as u32 + index;
            source += &format!(
                "@group(0) @binding({binding}) var<storage, {access}> pool_{index}: array<u32>;\n"
            );
        }
        source += if reads {
            "fn load_pool(word: u32) -> u32 {\n"
        } else {
            "fn store_pool(word: u32, value: u32) {\n"
        };
        let mask = (1u64 << pool.words_log2) - 1;
        for index in 0..pool.count {
            let place = if pool.count == 1 {
                "word".to_owned()
            } else {
                format!("word & {mask}u")
            };
            let body = match reads {
                true => format!("return pool_{index}[{place}];"),
                false => format!("pool_{index}[{place}] = value; return;"),
            };
            source += &match index + 1 == pool.count {
                true => format!("    {body}\n"),
                false => format!(
                    "    if (word >> {}u) == {index}u {{ {body} }}\n",
                    pool.words_log2
                ),
            };
        }
        source + "}\n"
    }
}

fn expand(file: &str, target: VisbufferTarget, imported: &mut Vec<String>) -> String {
    let mut source = String::new();
    for line in file.lines() {
        match line.strip_prefix("#import ") {
            Some(name) if imported.iter().any(|known| known == name) => {}
            Some(name) => {
                imported.push(name.to_owned());
                let shared = match name {
                    "visbuffer" => Some(target.source()),
                    name => SHARED.iter().find(|file| file.0 == name).map(|file| file.1),
                };
                match shared {
                    Some(shared) => source += &expand(shared, target, imported),
                    // Left as it is: naga names the line, and the test of all passes fails.
                    None => source += &format!("{line}\n"),
                }
            }
            None => {
                source += line;
                source += "\n";
            }
        }
    }
    source
}
