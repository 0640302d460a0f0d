//! Writes files so that they are complete or absent, and computes digests.
#![forbid(unsafe_code)]

use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::Path;

use sha2::{Digest, Sha256};

/// The system refused to read or write something.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action}")]
pub struct FileError {
    /// The action that failed, such as `write runs/a/summary.json`.
    pub action: String,
    /// The system's reason.
    #[source]
    pub source: std::io::Error,
}

/// (verb, path) => a function that turns the system's reason into a [`FileError`]; for `map_err`.
pub fn cannot(verb: &str, path: &Path) -> impl FnOnce(std::io::Error) -> FileError {
    let action = format!("{verb} {}", path.display());
    move |source| FileError { action, source }
}

/// Writes a file under a temporary name in the same directory and renames it, so that it is complete or absent.
///
/// # Errors
/// [`FileError`].
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    write_and_rename(path, bytes, true)
}

/// Like [`write_atomically`], but does not wait for the disk: after a power cut the file may be empty or missing.
///
/// # Errors
/// [`FileError`].
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    write_and_rename(path, bytes, false)
}

fn write_and_rename(path: &Path, bytes: &[u8], durable: bool) -> Result<(), FileError> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".partial");
    let partial = path.with_file_name(name);
    let write = || -> std::io::Result<()> {
        let mut file = File::create(&partial)?;
        file.write_all(bytes)?;
        if durable {
            file.sync_all()?;
        }
        fs::rename(&partial, path)
    };
    write().map_err(cannot("write", path))?;
    match path.parent().filter(|_| durable) {
        Some(directory) => sync_directory(directory),
        None => Ok(()),
    }
}

/// Waits until the disk has the entries of a directory: files that were made in it, renamed or removed.
///
/// # Errors
/// [`FileError`].
pub fn sync_directory(directory: &Path) -> Result<(), FileError> {
    // A path without a directory is in the working directory.
    let directory = if directory.as_os_str().is_empty() { Path::new(".") } else { directory };
    File::open(directory).and_then(|file| file.sync_all()).map_err(cannot("write", directory))
}

/// Reads a regular file of at most `limit` bytes. A pipe or a device is not opened, because reading it may never end.
///
/// # Errors
/// [`std::io::ErrorKind::InvalidInput`] for what is no regular file, [`std::io::ErrorKind::FileTooLarge`] for a larger one, and
/// those of the system.
pub fn read_regular(path: &Path, limit: u64) -> std::io::Result<Vec<u8>> {
    let metadata = fs::metadata(path)?;
    if metadata.is_dir() {
        return Err(std::io::ErrorKind::IsADirectory.into());
    }
    if !metadata.is_file() {
        return Err(std::io::Error::new(
            std::io::ErrorKind::InvalidInput,
            "it is a pipe or a device, and no regular file",
        ));
    }
    let too_large = |bytes: u64| {
        let reason = format!("it has {bytes} bytes; at most {limit} are read");
        std::io::Error::new(std::io::ErrorKind::FileTooLarge, reason)
    };
    if metadata.len() > limit {
        return Err(too_large(metadata.len()));
    }
    let mut bytes = Vec::new();
    // The file may grow while it is read.
    File::open(path)?.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit { Err(too_large(bytes.len() as u64)) } else { Ok(bytes) }
}

/// Creates a directory with its parents.
///
/// # Errors
/// [`FileError`].
pub fn create_directory(path: &Path) -> Result<(), FileError> {
    fs::create_dir_all(path).map_err(cannot("create the directory", path))
}

/// Returns the SHA-256 of bytes in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_as_a_whole() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("file");
        for (write, text) in [(write_atomically as fn(&Path, &[u8]) -> _, "first"), (write_whole, "second")] {
            write(&path, text.as_bytes()).expect("writable");
            assert_eq!(fs::read_to_string(&path).expect("readable"), text);
            assert_eq!(directory.path().read_dir().expect("readable").count(), 1, "nothing temporary is left");
        }
    }

    #[test]
    fn what_is_no_regular_file_or_too_large_is_not_read() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("file");
        fs::write(&path, b"12345").expect("writable");
        assert_eq!(read_regular(&path, 5).expect("readable"), b"12345");
        assert_eq!(read_regular(&path, 4).expect_err("too large").kind(), std::io::ErrorKind::FileTooLarge);
        for other in ["/dev/zero", "/dev/stdin"] {
            let kind = read_regular(Path::new(other), 5).expect_err("a device or a pipe").kind();
            assert!(
                [std::io::ErrorKind::InvalidInput, std::io::ErrorKind::NotFound].contains(&kind),
                "{other}: {kind}"
            );
        }
        assert!(read_regular(directory.path(), 5).is_err());
    }

    #[test]
    fn an_error_names_the_file() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("absent/file");
        let message = write_atomically(&path, b"").expect_err("no such directory").to_string();
        assert!(message.contains(&path.display().to_string()), "{message}");
    }

    #[test]
    fn the_digest_is_sha_256() {
        // The first test vector of FIPS 180-2.
        assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
