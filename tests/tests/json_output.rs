//! JSON output of commands that no other test covers: [`run`] validates it against the schema.

use e2e::{run, stderr};

#[test]
fn outputs_are_as_their_schemas_say() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let [hand, pads, shapes, scenes, page, parts, grasps] =
        ["hand.png", "pads", "shapes.png", "scenes", "page.html", "parts", "grasps.json"].map(at);
    let few = ["--object", "ball", "--each", "1", "--contacts", "2", "--chains", "64"];
    for arguments in [
        &["hand", "picture", "--out", &hand][..],
        &["hand", "export", "--mjcf", &scenes],
        &["optics", "pads", "--out", &pads],
        &["optics", "shapes", "--out", &shapes],
        &["optics", "eval", "--force"],
        &["grasps", "annotate", "--n", "2", "--out", &page],
        &[&["grasps", "collection", "--parts", &parts, "--out", &grasps][..], &few].concat(),
    ] {
        let output = run(&[arguments, &["--json"]].concat());
        assert!(output.status.success() && !output.stdout.is_empty(), "{arguments:?}: {}", stderr(&output));
    }
}
