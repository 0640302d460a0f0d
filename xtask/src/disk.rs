//! An ext4 file system in a file, whose power can be cut.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, bail};
use tempfile::TempDir;

/// Size of the file system in bytes.
const SIZE: u64 = 256 << 20;
/// Calls EXT4_IOC_SHUTDOWN with EXT4_GOING_FLAGS_NOLOGFLUSH, of fs/ext4/ext4.h, on a directory.
const CUT: &str = "import fcntl, os, struct, sys\n\
                   fcntl.ioctl(os.open(sys.argv[1], os.O_RDONLY), 0x8004587D, struct.pack('I', 2))";

/// The file system. It is mounted until it is dropped.
pub struct Disk {
    root: TempDir,
}

impl Disk {
    /// Makes and mounts one.
    ///
    /// # Errors
    /// The reason why that is not possible here: it needs root, `mkfs.ext4`, loop devices and `python3`.
    pub fn new() -> anyhow::Result<Disk> {
        let disk = Disk { root: tempfile::tempdir().context("cannot make a temporary directory")? };
        std::fs::File::create(disk.image()).and_then(|file| file.set_len(SIZE)).context("cannot make an image")?;
        std::fs::create_dir(disk.path()).context("cannot make a directory")?;
        run(Command::new("mkfs.ext4").arg("-q").arg(disk.image()))?;
        disk.mount()?;
        run(Command::new("python3").arg("--version"))?;
        Ok(disk)
    }

    /// Returns where it is mounted.
    pub fn path(&self) -> PathBuf {
        self.root.path().join("disk")
    }

    /// Stops the file system as a power cut does: what was not flushed is lost. Processes that use it still have to end before
    /// [`restart`](Self::restart).
    ///
    /// # Errors
    /// The system's reason.
    pub fn cut_power(&self) -> anyhow::Result<()> {
        run(Command::new("python3").args(["-c", CUT]).arg(self.path()))
    }

    /// Mounts it again after a power cut.
    ///
    /// # Errors
    /// The system's reason.
    pub fn restart(&self) -> anyhow::Result<()> {
        self.unmount()?;
        self.mount()
    }

    fn image(&self) -> PathBuf {
        self.root.path().join("image")
    }

    fn mount(&self) -> anyhow::Result<()> {
        run(Command::new("mount").args(["-o", "loop"]).args([self.image(), self.path()]))
    }

    fn unmount(&self) -> anyhow::Result<()> {
        run(Command::new("umount").arg(self.path()))
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // It is not mounted if it could not be.
        let _ = self.unmount();
    }
}

fn run(command: &mut Command) -> anyhow::Result<()> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.output().with_context(|| format!("cannot run {name}"))?;
    if output.status.success() {
        return Ok(());
    }
    bail!("{name}: {}", String::from_utf8_lossy(&output.stderr).trim())
}
