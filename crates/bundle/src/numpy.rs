//! `synergy.npz`: a control synergy as one archive of arrays.

use std::io::{Cursor, Write};

use eigenhand_synergy::{JointInfo, SynergyFile};
use npyz::WriterBuilder;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use crate::BundleError;

/// (control synergy) => the bytes of an archive that `numpy.load` reads
pub fn archive(file: &SynergyFile) -> Result<Vec<u8>, BundleError> {
    let synergy = &file.synergy;
    let (k, n) = (synergy.n_components(), synergy.n_joints());
    let mut archive = Archive { zip: ZipWriter::new(Cursor::new(Vec::new())) };
    archive.numbers("mean", &[n], synergy.mean())?;
    archive.numbers("components", &[k, n], synergy.components())?;
    archive.numbers("contribution", &[k], synergy.contribution())?;
    archive.numbers("z_low", &[k], synergy.coefficient_min())?;
    archive.numbers("z_high", &[k], synergy.coefficient_max())?;
    archive.axes("actuator", synergy.joints())?;
    if let Some(map) = &file.joint_map {
        archive.axes("joint", &map.joints)?;
        archive.numbers("joint_mean", &[map.joints.len()], &map.mean)?;
        archive.numbers("joint_matrix", &[k, map.joints.len()], &map.matrix.concat())?;
        archive.texts("free", &map.free)?;
    }
    Ok(archive.zip.finish()?.into_inner())
}

struct Archive {
    zip: ZipWriter<Cursor<Vec<u8>>>,
}

impl Archive {
    fn file(&mut self, name: &str, bytes: &[u8]) -> Result<(), BundleError> {
        // Without a time, so that the same synergy gives the same bytes.
        self.zip.start_file(
            format!("{name}.npy"),
            SimpleFileOptions::default().last_modified_time(zip::DateTime::default()),
        )?;
        Ok(self.zip.write_all(bytes)?)
    }

    /// Adds float64 numbers in C order.
    fn numbers(&mut self, name: &str, shape: &[usize], values: &[f64]) -> Result<(), BundleError> {
        let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
        let mut bytes = Vec::new();
        let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(&mut bytes).begin_nd()?;
        writer.extend(values.iter().copied())?;
        writer.finish()?;
        self.file(name, &bytes)
    }

    /// Adds names and limits of actuators or joints.
    fn axes(&mut self, kind: &str, axes: &[JointInfo]) -> Result<(), BundleError> {
        let of = |value: fn(&JointInfo) -> f64| axes.iter().map(value).collect::<Vec<_>>();
        self.texts(&format!("{kind}s"), &axes.iter().map(|axis| axis.name.clone()).collect::<Vec<_>>())?;
        self.numbers(&format!("{kind}_low"), &[axes.len()], &of(|axis| axis.lower))?;
        self.numbers(&format!("{kind}_high"), &[axes.len()], &of(|axis| axis.upper))
    }

    /// Adds an array of texts, as NumPy's `<U`: four bytes for each character, all texts of the same length.
    ///
    /// # Source
    /// NumPy's format description, `numpy/lib/format.py`, version 1.0.
    fn texts(&mut self, name: &str, texts: &[String]) -> Result<(), BundleError> {
        const ALIGNMENT: usize = 64;
        let length = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
        let mut header = format!("{{'descr': '<U{length}', 'fortran_order': False, 'shape': ({},), }}", texts.len());
        let magic = b"\x93NUMPY\x01\x00";
        let unpadded = magic.len() + size_of::<u16>() + header.len() + 1;
        header.extend(std::iter::repeat_n(' ', unpadded.next_multiple_of(ALIGNMENT) - unpadded));
        header.push('\n');
        let mut bytes = magic.to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        for text in texts {
            let padding = std::iter::repeat_n('\0', length - text.chars().count());
            bytes.extend(text.chars().chain(padding).flat_map(|letter| u32::from(letter).to_le_bytes()));
        }
        self.file(name, &bytes)
    }
}
