//! Bind group layouts by reflection of the assembled WGSL: what a variable is declared as is what is bound.

use wgpu::naga;

use super::device::Gpu;
use super::error::GpuError;

/// A pass's layout and the buffers' names in binding order.
#[derive(Debug)]
pub struct Layout {
    /// Layout of group 0.
    pub group: wgpu::BindGroupLayout,
    /// Name of the buffer of each binding; the pool's are `pool_0`, `pool_1`…
    pub names: Vec<String>,
}

/// Reads the storage variables of `source` and checks that binding `k` is the `k`-th of `expected`.
pub fn layout(
    gpu: &Gpu,
    pass: &'static str,
    source: &str,
    expected: &[&str],
    stages: wgpu::ShaderStages,
) -> Result<Layout, GpuError> {
    let wrong = |reason: String| GpuError::Pass { pass, reason };
    let module = naga::front::wgsl::parse_str(source)
        .map_err(|error| wrong(error.emit_to_string(source)))?;
    let mut found = Vec::new();
    for (_, variable) in module.global_variables.iter() {
        let (Some(place), naga::AddressSpace::Storage { access }) =
            (variable.binding, variable.space)
        else {
            continue;
        };
        found.push((
            place.binding,
            variable.name.clone().unwrap_or_default(),
            !access.contains(naga::StorageAccess::STORE),
        ));
    }
    found.sort();
    for (index, name) in expected.iter().enumerate() {
        if let Some((_, other, _)) = found.iter().find(|(at, ..)| *at as usize == index)
            && other != name
        {
            return Err(wrong(format!(
                "expected {name} at binding {index}, found {other}"
            )));
        }
    }
    let entries: Vec<_> = found
        .iter()
        .map(|&(binding, _, read_only)| wgpu::BindGroupLayoutEntry {
            binding,
            // A vertex stage that could write would need one more feature; none of ours does.
            visibility: match read_only {
                true => stages,
                false => stages.difference(wgpu::ShaderStages::VERTEX),
            },
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    let group = gpu
        .device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(pass),
            entries: &entries,
        });
    let mut names = vec![String::new(); found.last().map_or(0, |(at, ..)| *at as usize + 1)];
    for (at, name, _) in found {
        names[at as usize] = name;
    }
    Ok(Layout { group, names })
}
