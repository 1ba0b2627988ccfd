//! The pages that a post asked for, as far as its answer has not brought them: nothing else is
//! taken.

use std::collections::HashMap;

use lodestream_format::wire::{BlockHeader, BlockKind, PageStatus, PagesPost};
use lodestream_format::{ContentHash, FormatError};

use super::super::opened_scene::OpenedAsset;

/// See the module.
pub(super) struct Asked {
    pages: HashMap<(ContentHash, u32), Page>,
}

struct Page {
    frame_bytes: u64,
    /// Posts name a page once for each use of its asset.
    times: u32,
}

impl Asked {
    /// The pages of `post`, as far as `assets` have them.
    pub(super) fn new(post: &PagesPost, assets: &[OpenedAsset]) -> Self {
        let entries: HashMap<_, _> = assets
            .iter()
            .map(|opened| (opened.hash, &opened.asset.pages))
            .collect();
        let mut pages: HashMap<_, Page> = HashMap::new();
        for want in &post.wants {
            let known = entries.get(&want.asset).map_or(&[][..], |pages| &pages[..]);
            let last = want.last.saturating_add(1).min(known.len() as u32);
            for page in want.first..last {
                let asked = pages.entry((want.asset, page)).or_insert(Page {
                    frame_bytes: known[page as usize].bytes as u64,
                    times: 0,
                });
                asked.times += 1;
            }
        }
        Self { pages }
    }

    /// Looks at a block before its payload comes.
    ///
    /// # Errors
    /// [`FormatError`] for what was not asked for, came before, or has another size than the asset
    /// says.
    pub(super) fn announced(&mut self, header: &BlockHeader) -> Result<(), FormatError> {
        let at = format!("page {} of asset {}", header.page, header.hash);
        if header.kind != BlockKind::Page {
            return Err(FormatError::new(
                "block kind",
                "a page",
                format!("{:?}", header.kind),
            ));
        }
        let asked = self.pages.get_mut(&(header.hash, header.page));
        let Some(asked) = asked.filter(|asked| asked.times > 0) else {
            return Err(FormatError::new(
                at,
                "a page that was asked for, once",
                "another",
            ));
        };
        asked.times -= 1;
        let expected = match header.status {
            PageStatus::Ok => asked.frame_bytes,
            PageStatus::NotFound | PageStatus::Failed => 0,
        };
        match header.payload_bytes == expected {
            true => Ok(()),
            false => {
                let found = format!("{} bytes", header.payload_bytes);
                Err(FormatError::new(at, format!("{expected} bytes"), found))
            }
        }
    }
}
