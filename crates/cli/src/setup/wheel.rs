//! MuJoCo's library out of its Python package on PyPI, for systems that offer no package of it.

use std::fs;
use std::io::{Cursor, Read};
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, bail};
use eigenhand_files::{cannot, create_directory, sha256};
use eigenhand_mujoco::{LIBRARY_FILE, LIBRARY_VARIABLE, fetched_library};
use eigenhand_train::say;
use ureq::tls::{RootCerts, TlsConfig};

use super::PREVENTION;

const HOST: &str = "https://files.pythonhosted.org/packages/";
/// No wheel of MuJoCo 2.2.2 is larger.
const MOST_BYTES: u64 = 32 << 20;
const PATIENCE: Duration = Duration::from_secs(120);

/// A wheel of MuJoCo 2.2.2. They differ in the Python they are for, which does not matter here: the library is the same.
struct Wheel {
    /// Operating system and processor, as the standard library names them.
    system: (&'static str, &'static str),
    path: &'static str,
    sha256: &'static str,
}

const WHEELS: [Wheel; 4] = [
    Wheel {
        system: ("linux", "x86_64"),
        path: "6d/d4/e6a78b0124f5e196f621a3420c8c7d6b602e891e0b97344210d56dc0f0b4/\
               mujoco-2.2.2-cp310-cp310-manylinux_2_17_x86_64.manylinux2014_x86_64.whl",
        sha256: "a074ea3d63ecc504367df46aa73b3066cd9e7d7ebfe8a48261fba04a9ca232ea",
    },
    Wheel {
        system: ("linux", "aarch64"),
        path: "17/8e/01e0c991e8506896e8338c266c897c5cd6f0179ab2a371f607f5a421f952/\
               mujoco-2.2.2-cp310-cp310-manylinux_2_17_aarch64.manylinux2014_aarch64.whl",
        sha256: "ea42cb51e69e9001a71d8a26408288772cf3450a0e8cc5de99d7fa1c5a81584a",
    },
    Wheel {
        system: ("macos", "x86_64"),
        path: "d9/20/97e18035eff7e79713c62d32ceb9fabff6e93e6c5d12682c939d08fe979f/\
               mujoco-2.2.2-cp310-cp310-macosx_10_12_x86_64.whl",
        sha256: "6cb6e3779037981d87249d443f4c67136c97f5f90911f8a6820805aaf802d1bd",
    },
    Wheel {
        system: ("macos", "aarch64"),
        path: "26/d2/741b7a187d228099566d126108d34ae08ca950769701dd27d1eb4fe9a559/\
               mujoco-2.2.2-cp310-cp310-macosx_11_0_arm64.whl",
        sha256: "a4c6dab19c0cc2699576686038fad0af8bf286ea0848994caeb38c1be141abdd",
    },
];

/// Fetches the library into the user's cache, from which MuJoCo is loaded. Returns false if there is none for this system.
///
/// # Errors
/// Errors of the network and the disk, and a file that is not the expected one.
pub(super) fn fetch() -> anyhow::Result<bool> {
    let system = (std::env::consts::OS, std::env::consts::ARCH);
    let Some(wheel) = WHEELS.iter().find(|wheel| wheel.system == system) else { return Ok(false) };
    let library = fetched_library().context("there is no home directory for MuJoCo; set HOME")?;
    let url = format!("{HOST}{}", wheel.path);
    say!("MuJoCo is missing. Fetching MuJoCo 2.2.2 (4 MB) from PyPI into the user's cache:");
    say!("  {url}\n  -> {}", library.display());
    say!("{PREVENTION}");
    let bytes = download(&url).with_context(|| {
        format!(
            "cannot fetch {url}; to use a library of your own, set {LIBRARY_VARIABLE} to the path of its {LIBRARY_FILE}"
        )
    })?;
    unpack(&bytes, wheel.sha256, &library)?;
    Ok(true)
}

fn download(url: &str) -> anyhow::Result<Vec<u8>> {
    let certificates = TlsConfig::builder().root_certs(RootCerts::PlatformVerifier).build();
    let agent = ureq::Agent::config_builder().tls_config(certificates).timeout_global(Some(PATIENCE)).build();
    let mut response = ureq::Agent::new_with_config(agent).get(url).call()?;
    Ok(response.body_mut().with_config().limit(MOST_BYTES).read_to_vec()?)
}

/// Checks the digest of a wheel, and writes its library and its licences into the library's directory.
fn unpack(wheel: &[u8], digest: &str, library: &Path) -> anyhow::Result<()> {
    let found = sha256(wheel);
    if found != digest {
        bail!("the file is not the expected one: its SHA-256 is {found}, and {digest} was expected; nothing was kept");
    }
    let directory = library.parent().unwrap_or(Path::new("."));
    let cache = directory.parent().unwrap_or(Path::new("."));
    create_directory(cache)?;
    // Removed with its contents if a line below fails.
    let partial = tempfile::Builder::new().prefix(".mujoco-").tempdir_in(cache).map_err(cannot("write in", cache))?;
    let mut archive = zip::ZipArchive::new(Cursor::new(wheel)).context("the wheel cannot be read")?;
    for index in 0..archive.len() {
        let mut file = archive.by_index(index).context("the wheel cannot be read")?;
        let Some(name) = file.enclosed_name().and_then(|path| Some(path.file_name()?.to_owned())) else { continue };
        let text = name.to_string_lossy();
        if text == LIBRARY_FILE || text.starts_with("LICENSE") {
            let mut content = Vec::new();
            file.read_to_end(&mut content).context("the wheel cannot be read")?;
            let place = partial.path().join(&name);
            fs::write(&place, content).map_err(cannot("write", &place))?;
        }
    }
    match fs::rename(partial.path(), directory) {
        // Another process was faster.
        Err(_) if library.is_file() => Ok(()),
        outcome => Ok(outcome.map_err(cannot("write", directory))?),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn wheel(names: &[&str]) -> Vec<u8> {
        let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for name in names {
            archive.start_file(*name, zip::write::SimpleFileOptions::default()).expect("writable");
            archive.write_all(name.as_bytes()).expect("writable");
        }
        archive.finish().expect("writable").into_inner()
    }

    #[test]
    fn the_library_and_the_licences_are_unpacked_and_nothing_else() {
        let root = tempfile::tempdir().expect("a directory");
        let library = root.path().join("cache").join("mujoco").join(LIBRARY_FILE);
        let within = format!("mujoco/{LIBRARY_FILE}");
        let names = [within.as_str(), "mujoco/__init__.py", "mujoco-2.2.2.dist-info/LICENSE", "../LICENSE-outside"];
        let bytes = wheel(&names);
        // Twice, as two processes would.
        for _ in 0..2 {
            unpack(&bytes, &sha256(&bytes), &library).expect("unpacked");
        }
        assert_eq!(fs::read_to_string(&library).expect("there"), within);
        let list = |path: &Path| {
            let mut names: Vec<_> =
                path.read_dir().expect("there").map(|entry| entry.expect("readable").file_name()).collect();
            names.sort();
            names
        };
        assert_eq!(list(library.parent().expect("a directory")), ["LICENSE", LIBRARY_FILE]);
        assert_eq!(list(&root.path().join("cache")), ["mujoco"]);
    }

    #[test]
    fn a_file_with_another_digest_is_refused_and_not_kept() {
        let root = tempfile::tempdir().expect("a directory");
        let library = root.path().join("cache").join("mujoco").join(LIBRARY_FILE);
        let error = unpack(b"not the wheel", WHEELS[0].sha256, &library).expect_err("another digest");
        assert!(error.to_string().contains(WHEELS[0].sha256), "{error}");
        assert!(!root.path().join("cache").exists());
    }
}
