//! Allowance: what one import may reach and take, from files beside the model to memory.

use std::cell::Cell;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use super::OpenOptions;
use super::error::{Fault, Read, malformed, quoted};
use super::uri;

/// Files and memory that one import may have.
pub(super) struct Allowance<'a> {
    /// Where files that the model names must lie; `None`: none is opened, looked for or told of.
    folder: Option<&'a Path>,
    /// Bytes of memory; the last eighth of the limit is left to all that is not counted.
    most_bytes: Option<u64>,
    /// Bytes held to the end of the import.
    taken_bytes: Cell<u64>,
    /// Most pixels of an image.
    pub(super) max_image_pixels: u64,
}

impl<'a> Allowance<'a> {
    /// `folder` is the model's.
    pub(super) fn new(folder: &'a Path, options: &OpenOptions) -> Self {
        Self {
            folder: (!options.self_contained).then_some(folder),
            most_bytes: options.memory_limit_bytes.map(|limit| limit / 8 * 7),
            taken_bytes: Cell::new(0),
            max_image_pixels: options.max_image_pixels,
        }
    }

    /// Whether references to other files count for nothing.
    pub(super) fn is_self_contained(&self) -> bool {
        self.folder.is_none()
    }

    /// The existing file `name` below the model's folder, links resolved.
    pub(super) fn file(&self, name: &str, place: &str) -> Read<PathBuf> {
        match self.folder {
            Some(folder) => uri::file_below(name, folder, place),
            None => Err(outside(name, place)),
        }
    }

    /// The existing file that a mesh file calls `name`, below the model's folder, links resolved.
    /// Such names often begin with folders of another machine, in its spelling: what follows them
    /// is looked for, too, the longest first.
    pub(super) fn beside(&self, name: &str, place: &str) -> Read<PathBuf> {
        let name = name.trim_matches('"').replace('\\', "/");
        let named = match self.file(&name, place) {
            Err(fault) if !self.is_self_contained() => fault,
            found => return found,
        };
        let found = uri::ends(&name).find_map(|end| self.file(end, place).ok());
        let spelt = |end: &str| self.file(&self.spelt(end)?, place).ok();
        let found = found.or_else(|| {
            std::iter::once(&*name)
                .chain(uri::ends(&name))
                .find_map(spelt)
        });
        found.ok_or(named)
    }

    /// `name` as the folders below the model's spell it, where one file of a folder alone has it
    /// in letters of another case.
    fn spelt(&self, name: &str) -> Option<String> {
        /// Files of a folder that are looked at.
        const MOST_FILES: usize = 1 << 12;
        /// Bytes of the longest name of a file.
        const NAME_BYTES: usize = 255;
        let mut folder = self.folder?.to_owned();
        let mut spelt = Vec::new();
        for part in name.split('/').filter(|it| !matches!(*it, "" | ".")) {
            if part == ".." || part.len() > NAME_BYTES {
                return None;
            }
            let mut found = part.to_owned();
            if !folder.join(part).exists() {
                let files = std::fs::read_dir(&folder).ok()?.take(MOST_FILES);
                let names = files.filter_map(|it| it.ok()?.file_name().into_string().ok());
                let small = part.to_lowercase();
                let mut same = names.filter(|it| it.to_lowercase() == small);
                found = same.next()?;
                if same.next().is_some() {
                    return None;
                }
            }
            folder.push(&found);
            spelt.push(found);
        }
        Some(spelt.join("/"))
    }

    /// Follows `uri`: inline data, or a file as [`Allowance::file`] has it.
    pub(super) fn resolve(&self, uri: &str, place: &str) -> Read<uri::Target> {
        match self.folder {
            None if !uri::is_data(uri) => Err(outside(uri, place)),
            folder => uri::resolve(uri, folder.unwrap_or(Path::new("")), place),
        }
    }

    /// Bytes that are neither taken nor out of reach; `u64::MAX` without a limit.
    pub(super) fn left_bytes(&self) -> u64 {
        let left = |most: u64| most.saturating_sub(self.taken_bytes.get());
        self.most_bytes.map_or(u64::MAX, left)
    }

    /// Demands room for `bytes` beside what is taken; `place` needs them for a while.
    pub(super) fn fits(&self, bytes: u64, place: impl Display) -> Read<()> {
        match bytes <= self.left_bytes() {
            true => Ok(()),
            false => {
                let most = self.most_bytes.unwrap_or(u64::MAX);
                let expected =
                    format!("a model that is imported within {most} bytes (--memory-limit)");
                let need = bytes.saturating_add(self.taken_bytes.get());
                Err(malformed(
                    place,
                    expected,
                    format!("a need of {need} or more"),
                ))
            }
        }
    }

    /// The same for as long as the import goes on.
    pub(super) fn take(&self, bytes: u64, place: impl Display) -> Read<()> {
        self.fits(bytes, place)?;
        self.taken_bytes
            .set(self.taken_bytes.get().saturating_add(bytes));
        Ok(())
    }
}

/// A reference to another file from a model that must be self-contained.
fn outside(name: &str, place: &str) -> Fault {
    let found = format!("a reference to another file, {}", quoted(name));
    malformed(place, "data inside the model (--self-contained)", found)
}
