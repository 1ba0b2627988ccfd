//! What naga says about the assembled passes: layouts of structs and values of constants.

#![allow(dead_code)] // Every test file uses its part.

use std::collections::{BTreeMap, BTreeSet};

use lodestream_shaders::passes::{ALL, Pass, PoolBindings};
use naga::proc::Layouter;
use naga::{AddressSpace, Expression, Handle, Literal, Module, ScalarKind, Type, TypeInner};

/// The pool as these modules bind it.
pub const POOL: PoolBindings = PoolBindings {
    count: 2,
    words_log2: 25,
};

/// Kind of number that a field consists of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Float,
    Uint,
    Struct,
    Other,
}

/// A Rust type that may be a field.
pub trait Field {
    const KIND: Kind;
}

impl Field for f32 {
    const KIND: Kind = Kind::Float;
}

impl Field for u32 {
    const KIND: Kind = Kind::Uint;
}

impl Field for lodestream_format::hierarchy::Child {
    const KIND: Kind = Kind::Struct;
}

impl<T: Field, const N: usize> Field for [T; N] {
    const KIND: Kind = T::KIND;
}

/// One field.
#[derive(Debug, Clone)]
pub struct Member {
    pub name: String,
    pub offset: usize,
    pub size: usize,
    pub kind: Kind,
}

/// A struct.
#[derive(Debug, Clone)]
pub struct Layout {
    pub size: usize,
    pub members: Vec<Member>,
}

/// Every pass, parsed.
pub fn modules() -> Vec<(Pass, Module)> {
    let parse = |pass: Pass| {
        let source = pass.source(POOL);
        let module = naga::front::wgsl::parse_str(&source)
            .unwrap_or_else(|error| panic!("{}: {}", pass.name, error.emit_to_string(&source)));
        (pass, module)
    };
    ALL.into_iter().map(parse).collect()
}

/// Every struct of a module, and whether a binding has it.
pub fn structs(module: &Module) -> Vec<(String, Layout, bool)> {
    let mut layouter = Layouter::default();
    layouter
        .update(module.to_ctx())
        .expect("naga lays out what it parsed");
    let mut crossing = BTreeSet::new();
    for (_, variable) in module.global_variables.iter() {
        if matches!(
            variable.space,
            AddressSpace::Storage { .. } | AddressSpace::Uniform
        ) {
            collect(module, variable.ty, &mut crossing);
        }
    }
    let mut found = Vec::new();
    for (handle, ty) in module.types.iter() {
        let TypeInner::Struct { members, span } = &ty.inner else {
            continue;
        };
        let members = members.iter().map(|member| Member {
            name: member.name.clone().unwrap_or_default(),
            offset: member.offset as usize,
            size: layouter[member.ty].size as usize,
            kind: kind(module, member.ty),
        });
        let layout = Layout {
            size: *span as usize,
            members: members.collect(),
        };
        found.push((
            ty.name.clone().unwrap_or_default(),
            layout,
            crossing.contains(&handle),
        ));
    }
    found
}

fn collect(module: &Module, handle: Handle<Type>, found: &mut BTreeSet<Handle<Type>>) {
    match &module.types[handle].inner {
        TypeInner::Array { base, .. } => collect(module, *base, found),
        TypeInner::Struct { members, .. } => {
            found.insert(handle);
            members
                .iter()
                .for_each(|member| collect(module, member.ty, found));
        }
        _ => {}
    }
}

fn kind(module: &Module, handle: Handle<Type>) -> Kind {
    match &module.types[handle].inner {
        TypeInner::Scalar(scalar)
        | TypeInner::Atomic(scalar)
        | TypeInner::Vector { scalar, .. }
        | TypeInner::Matrix { scalar, .. } => match (scalar.kind, scalar.width) {
            (ScalarKind::Float, 4) => Kind::Float,
            (ScalarKind::Uint, 4) => Kind::Uint,
            _ => Kind::Other,
        },
        TypeInner::Array { base, .. } => kind(module, *base),
        TypeInner::Struct { .. } => Kind::Struct,
        _ => Kind::Other,
    }
}

/// Named constants of a module; `None` for one that is no number.
pub fn constants(module: &Module) -> BTreeMap<String, Option<f64>> {
    let value = |constant: &naga::Constant| match module.global_expressions[constant.init] {
        Expression::Literal(Literal::U32(value)) => Some(value as f64),
        Expression::Literal(Literal::I32(value)) => Some(value as f64),
        Expression::Literal(Literal::F32(value)) => Some(value as f64),
        _ => None,
    };
    let named = module.constants.iter();
    named
        .filter_map(|(_, constant)| Some((constant.name.clone()?, value(constant))))
        .collect()
}
