//! Contact sheets: models beside the pictures that their makers expect. `sheets-*.json`, which
//! `cases/sheets.py` writes, with the pictures as base64 of PNG.

use std::fmt::Write;

use super::sections::{rows, section as titled};
use super::{Runs, escape};

pub(super) fn section(runs: &Runs) -> String {
    let mut body = String::new();
    for row in runs.of("sheets").flat_map(|run| rows(run, "rows")) {
        let text = |key: &str| row[key].as_str().unwrap_or_default();
        let (model, note) = (escape(text("model")), escape(text("note")));
        // Base64 has no character that HTML reads as anything else; a stranger's text might.
        let picture = escape(text("png"));
        let _ = write!(
            body,
            "<figure class=\"s\"><img src=\"data:image/png;base64,{picture}\" alt=\"{model}\">\
             <figcaption>{model} {note}</figcaption></figure>"
        );
    }
    titled(
        "Contact sheets",
        "Expected to the left, drawn here to the right. Light and background differ.",
        body,
    )
}

#[cfg(test)]
mod tests {
    use super::super::{Run, Runs};
    use super::*;

    #[test]
    fn pictures_lie_in_the_page() {
        let run = Run {
            name: "khronos".into(),
            json: serde_json::json!({ "rows": [
                { "model": "Box<1>", "png": "iVBORw0KGgo=", "note": "not drawn" },
            ] }),
        };
        let runs = Runs {
            runs: vec![("sheets".into(), run)],
            pictures: Vec::new(),
        };
        let page = section(&runs);
        assert!(
            page.contains("src=\"data:image/png;base64,iVBORw0KGgo=\""),
            "{page}"
        );
        assert!(page.contains("Box&lt;1&gt; not drawn"), "{page}");
    }
}
