//! Assets in an object store: one in Python, which checks signatures by itself.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use fantex_test::skip;

use crate::{COLORED_PLY, fantex, succeeds, write};

/// Serves a folder as a bucket `scans`.
struct Store {
    child: Child,
    endpoint: String,
}

impl Drop for Store {
    fn drop(&mut self) {
        self.child.kill().unwrap_or_default();
        drop(self.child.wait());
    }
}

/// The keys that the store knows. (Those of Amazon's examples.)
const KEYS: [(&str, &str); 2] = [
    ("AWS_ACCESS_KEY_ID", "AKIAIOSFODNN7EXAMPLE"),
    ("AWS_SECRET_ACCESS_KEY", "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY"),
];

/// None where there is no Python. Everybody may read the object `public.fan`.
fn serve(folder: &Path) -> Option<Store> {
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/object_store.py");
    let mut command = Command::new("python3");
    command.arg(program).arg(folder).args(["scans", KEYS[0].1, KEYS[1].1, "public.fan"]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().ok()?;
    let mut line = String::new();
    BufReader::new(child.stdout.take()?).read_line(&mut line).ok()?;
    let port: u16 = line.trim().parse().ok()?;
    Some(Store { child, endpoint: format!("http://127.0.0.1:{port}") })
}

#[test]
fn an_asset_in_an_object_store_is_read_by_who_may() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = folder.path().join("bucket");
    std::fs::create_dir(&bucket).unwrap();
    let asset = bucket.join("a b.fan");
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"64k"]);
    std::fs::copy(&asset, bucket.join("public.fan")).unwrap();
    let Some(store) = serve(&bucket) else { return skip("no python3, in which the object store is written") };
    let run = |arguments: &[&str], keys: &[(&str, &str)]| {
        let mut command = fantex();
        command.args(arguments).env("AWS_ENDPOINT_URL", &store.endpoint).env("AWS_REGION", "eu-west-1");
        for name in ["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_ENDPOINT_URL_S3"]
        {
            command.env_remove(name);
        }
        command.envs(keys.iter().copied()).output().unwrap()
    };
    let picture = |place: &str, name: &str, keys: &[(&str, &str)]| {
        let out = folder.path().join(name);
        let output = run(&["render", place, "--size", "160x120", "-o", out.to_str().unwrap()], keys);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read(out).unwrap()
    };
    let here = picture(asset.to_str().unwrap(), "here.png", &[]);
    assert_eq!(picture("s3://scans/a b.fan", "there.png", &KEYS), here);
    assert_eq!(picture("s3://scans/public.fan", "public.png", &[]), here);
    assert!(run(&["--json", "verify", "s3://scans/a b.fan"], &KEYS).status.success());

    let refused = |place: &str, keys: &[(&str, &str)], words: &[&str]| {
        let output = run(&["info", place], keys);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
        assert!(!said.contains("X-Amz") && said.trim().lines().count() == 1, "{said}");
    };
    refused("s3://scans/a b.fan", &[], &["s3://scans/a b.fan", "403", "set AWS_ACCESS_KEY_ID"]);
    let wrong = [KEYS[0], ("AWS_SECRET_ACCESS_KEY", "wrong")];
    refused("s3://scans/a b.fan", &wrong, &["403", "check AWS_ACCESS_KEY_ID"]);
    refused("s3://scans/other.fan", &KEYS, &["404"]);
    refused("s3://scans", &KEYS, &["s3://BUCKET/KEY"]);
}
