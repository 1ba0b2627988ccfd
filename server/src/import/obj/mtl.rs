//! MTL: the material library beside an OBJ, found, read, and made materials of.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::surface::{Entry, Settled};
use crate::import::allowance::Allowance;
use crate::import::error::{Read, quoted, short};
use crate::import::images::Gauge;
use crate::import::scene::{Image, Material, short_name};
use crate::import::warnings::Warnings;
use crate::import::{plain, text};

/// Materials by name, from all libraries that a file names; the first of a name counts.
#[derive(Default)]
pub(super) struct Library {
    known: HashMap<String, Known>,
    /// Files that were read.
    loaded: HashSet<PathBuf>,
    looked_for: usize,
}

struct Known {
    entry: Settled,
    /// Of its library, as the model names it; may be empty.
    folder: Arc<str>,
}

/// Files that are looked for in a model; more would cost much and say little.
const MOST_LIBRARIES: usize = 1024;
/// Materials that are kept of all libraries; a mesh uses a quarter of them at most.
const MOST_MATERIALS: usize = 1 << 18;

impl Library {
    /// Loads the libraries in the line `mtllib NAMES`: one name, blanks included, where there is such a file, else several.
    pub(super) fn load(
        &mut self,
        names: &str,
        allowance: &Allowance,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<()> {
        if allowance.is_self_contained() {
            let what = "material libraries left out (--self-contained)";
            warnings.add(what, 1, &format!("{place} {}", quoted(names)));
            return Ok(());
        }
        if !names.contains(char::is_whitespace) {
            return self.load_one(names, allowance, place, warnings);
        }
        match self.find(names, allowance, place) {
            Ok(path) => self.load_file(&path, names, allowance, place, warnings),
            Err(_) => names
                .split_whitespace()
                .take_while(|name| !name.starts_with('#'))
                .take(MOST_LIBRARIES + 1)
                .try_for_each(|name| self.load_one(name, allowance, place, warnings)),
        }
    }

    fn find(&mut self, name: &str, allowance: &Allowance, place: &str) -> Read<PathBuf> {
        self.looked_for += 1;
        allowance.beside(name, place)
    }

    fn load_one(
        &mut self,
        name: &str,
        allowance: &Allowance,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<()> {
        if self.looked_for >= MOST_LIBRARIES {
            let what = format!("material libraries beyond the first {MOST_LIBRARIES} left out");
            warnings.add(what, 1, place);
            return Ok(());
        }
        match self.find(name, allowance, place) {
            Ok(path) => self.load_file(&path, name, allowance, place, warnings),
            Err(fault) => {
                warnings.add(format!("material libraries left out ({fault})"), 1, place);
                Ok(())
            }
        }
    }

    fn load_file(
        &mut self,
        path: &Path,
        name: &str,
        allowance: &Allowance,
        place: &str,
        warnings: &mut Warnings,
    ) -> Read<()> {
        // The first of a name counts, so that a library says nothing new the second time.
        if !self.loaded.insert(path.to_owned()) {
            return Ok(());
        }
        match allowance.read(path, name, place) {
            Ok(bytes) => {
                // The text and what it says.
                allowance.fits(3 * bytes.len() as u64, place)?;
                let text = String::from_utf8_lossy(text::without_mark(&bytes));
                self.parse(&text, name, warnings);
                Ok(())
            }
            Err(fault) => {
                warnings.add(format!("material libraries left out ({fault})"), 1, place);
                Ok(())
            }
        }
    }

    /// Takes in the text of the library that the model calls `name`.
    fn parse(&mut self, library: &str, name: &str, warnings: &mut Warnings) {
        let (folder, file) = name.rsplit_once(['/', '\\']).unwrap_or(("", name));
        let folder: Arc<str> = folder.into();
        let mut current: Option<(String, Entry)> = None;
        // Old programs of the Macintosh end lines by a carriage return alone.
        let lines = (1u64..).zip(library.lines());
        let statements =
            lines.flat_map(|(number, line)| line.split('\r').map(move |it| (number, it)));
        for (number, line) in statements {
            let place = format!("{file} line {number}");
            let line = line.trim();
            let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
            let rest = rest.trim();
            if keyword.eq_ignore_ascii_case("newmtl") {
                self.keep(current.take(), &folder, warnings);
                current = Some((rest.to_owned(), Entry::new(rest)));
            } else if let Some((_, entry)) = &mut current {
                entry.statement(keyword, rest, &place, warnings);
            }
        }
        self.keep(current, &folder, warnings);
    }

    fn keep(&mut self, entry: Option<(String, Entry)>, folder: &Arc<str>, warnings: &mut Warnings) {
        if let Some((name, entry)) = entry
            && self.known.len() < MOST_MATERIALS
        {
            let entry = entry.settled(warnings);
            let folder = Arc::clone(folder);
            self.known.entry(name).or_insert(Known { entry, folder });
        }
    }

    /// The materials of `names`, with their images, each once. Textures are of no use to a mesh that is not `textured`.
    pub(super) fn materials(
        &self,
        names: &[Option<String>],
        allowance: &Allowance,
        textured: bool,
        warnings: &mut Warnings,
    ) -> Read<(Vec<Material>, Vec<Image>)> {
        let mut gauge = Gauge::new(allowance);
        let mut images = Vec::new();
        let mut image_of_name: HashMap<&str, Option<u32>> = HashMap::new();
        let mut materials = Vec::with_capacity(names.len());
        for name in names {
            let Some(name) = name else {
                materials.push(plain::material());
                continue;
            };
            // A `#` may be of a name, or begin a comment.
            let before_comment = || self.known.get(name.split_once(" #")?.0.trim_end());
            let known = self.known.get(name).or_else(before_comment);
            let Some(Known { entry, folder }) = known else {
                let what = "materials that no library defines read as plain";
                warnings.add(what, 1, &format!("usemtl {}", short(name)));
                materials.push(Material {
                    name: short_name(name),
                    ..plain::material()
                });
                continue;
            };
            let mut material = entry.material.clone();
            if let Some(texture) = &entry.texture {
                if !textured {
                    let what = "textures of a mesh without texture coordinates left out";
                    warnings.add(what, 1, &texture.place);
                } else if let Some(known) = image_of_name.get(&*texture.name) {
                    material.base_color_image = *known;
                } else {
                    // Relative to the model, else to its library.
                    let beside = format!("{folder}/{}", texture.name);
                    let is_there = |name| allowance.beside(name, &texture.place).is_ok();
                    let name = match !is_there(&texture.name) && is_there(&beside) {
                        true => &beside,
                        false => &texture.name,
                    };
                    let image = gauge.beside(name, &texture.place, warnings)?;
                    let number = image.is_some().then_some(images.len() as u32);
                    images.extend(image);
                    image_of_name.insert(&texture.name, number);
                    material.base_color_image = number;
                }
            }
            materials.push(material);
        }
        let images = gauge.decodable(images, &mut materials, warnings);
        Ok((materials, images))
    }
}
