//! Judges: triangles and bytes over the error, a curve a run. Files `judges-*.json`, which
//! `judges/__main__.py` writes.

use serde_json::Value;

use super::sections::{json_table, plot, rows, section as titled};
use super::{Run, Runs, Series, escape};

const COLUMNS: [(&str, &str); 14] = [
    ("model", "model"),
    ("largest distance / E, median", "used"),
    ("most", "largest"),
    ("triangles at E / plain simplifier", "ratio_judged"),
    ("triangles at 1 px", "triangles"),
    ("a covered pixel", "triangles_a_pixel"),
    ("bytes", "bytes"),
    ("pages", "pages"),
    ("PSNR dB", "psnr_db"),
    ("stored / measured p50", "p50"),
    ("p95", "p95"),
    ("groups that exceed", "unbounded"),
    ("groups", "measured"),
    ("build s", "build_secs"),
];

pub(super) fn section(runs: &Runs) -> String {
    let runs: Vec<&Run> = runs.of("judges").collect();
    let mut body = String::new();
    for model in shared_models(&runs) {
        let curves = |list: &str, x: &str, y: &str| -> Vec<Series> {
            let of = |run: &&Run| curve(run.name.clone(), run, list, &model, [x, y]);
            runs.iter().map(of).collect()
        };
        let mut cuts = curves("cuts", "share", "triangles");
        if let Some(run) = runs.last() {
            let axes = ["share", "plain_judged"];
            cuts.push(curve("plain simplifier".into(), run, "cuts", &model, axes));
        }
        let asked = "error, share of the diagonal";
        let error = "error, pixels";
        for (title, x, y, series) in [
            ("Triangles of the cut", asked, "triangles", cuts),
            (
                "Triangles drawn",
                error,
                "triangles",
                curves("curves", "error_px", "triangles"),
            ),
            (
                "Bytes fetched",
                error,
                "bytes",
                curves("curves", "error_px", "bytes"),
            ),
        ] {
            body += &plot(&format!("{title}: {model}"), [x, y], [true, true], series);
        }
    }
    for run in &runs {
        let table = json_table(rows(run, "rows"), &COLUMNS);
        if !table.is_empty() {
            body += &format!("<h3>{}</h3>{table}", escape(&run.name));
        }
    }
    titled(
        "Judges: triangles and bytes for an error",
        "Exact distances both ways between cut and source; a whole-mesh simplifier that knows \
         neither attributes nor levels; the default view of 960x540 pixels.",
        body,
    )
}

/// Models with points in every run, as the first run orders them.
fn shared_models(runs: &[&Run]) -> Vec<String> {
    let has = |run: &Run, model: &str| {
        ["cuts", "curves"]
            .iter()
            .any(|list| rows(run, list).any(|row| row["model"] == model))
    };
    let mut models: Vec<String> = Vec::new();
    let Some((first, others)) = runs.split_first() else {
        return models;
    };
    let named = ["cuts", "curves"]
        .iter()
        .flat_map(|list| rows(first, list))
        .filter_map(|row| row["model"].as_str());
    for model in named {
        if !models.iter().any(|known| known == model) && others.iter().all(|run| has(run, model)) {
            models.push(model.into());
        }
    }
    models
}

fn curve(name: String, run: &Run, list: &str, model: &str, [x, y]: [&str; 2]) -> Series {
    let point = |row: &Value| row[x].as_f64().zip(row[y].as_f64());
    let points = rows(run, list)
        .filter(|row| row["model"] == model)
        .filter_map(point)
        .collect();
    Series { name, points }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(name: &str, models: &[&str]) -> (String, Run) {
        let cuts: Vec<Value> = models
            .iter()
            .flat_map(|model| {
                [1e-3, 1e-2].map(|share| {
                    serde_json::json!({
                        "model": model, "share": share, "triangles": 1.0 / share, "plain_judged": 50,
                    })
                })
            })
            .collect();
        let json =
            serde_json::json!({ "cuts": cuts, "rows": [{ "model": models[0], "pages": 7 }] });
        let name = name.to_owned();
        ("judges".into(), Run { name, json })
    }

    #[test]
    fn runs_stand_over_each_other_for_the_models_that_both_have() {
        let runs = Runs {
            runs: vec![run("after", &["rock", "oak"]), run("before", &["oak"])],
            pictures: Vec::new(),
        };
        let page = section(&runs);
        assert!(page.contains("Triangles of the cut: oak"), "{page}");
        assert!(!page.contains(": rock"), "{page}");
        // Two runs and the plain simplifier.
        assert_eq!(page.matches("<polyline").count(), 3, "{page}");
        assert!(page.contains("<h3>before</h3><table>"), "{page}");
    }
}
