//! The job script of a sweep for Slurm (`sbatch(1)`): an array with one task for each run.

use std::path::Path;

use super::Slurm;

/// Name of the script in the directory of a sweep.
pub const SCRIPT: &str = "sweep.sbatch";

/// Returns the script. `command` trains the run whose number follows it; Slurm calls the script with the stage as its argument.
///
/// A job that is pre-empted gets SIGTERM, so its run is saved; Slurm then queues it again, and it resumes.
pub fn script(slurm: &Slurm, name: &str, directory: &Path, command: &str) -> String {
    let Slurm { cpus, options } = slurm;
    let options: String = options.iter().map(|option| format!("#SBATCH {option}\n")).collect();
    let log = directory.join("slurm-%a.log");
    format!(
        "#!/bin/bash\n#SBATCH --job-name={name}\n#SBATCH --cpus-per-task={cpus}\n#SBATCH --requeue\n\
         #SBATCH --open-mode=append\n#SBATCH --output={}\n{options}\
         exec {command} --workers \"$SLURM_CPUS_PER_TASK\" --stage \"$1\" --task \"$SLURM_ARRAY_TASK_ID\"\n",
        log.display()
    )
}

/// Returns the tasks of an array in the form of `--array`: `[0, 1, 2, 5]` => `0-2,5`
pub fn array(tasks: &[usize]) -> String {
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for &task in tasks {
        match ranges.last_mut() {
            Some((_, end)) if *end + 1 == task => *end = task,
            _ => ranges.push((task, task)),
        }
    }
    let range = |(start, end): &(usize, usize)| if start == end { start.to_string() } else { format!("{start}-{end}") };
    ranges.iter().map(range).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_are_named_by_ranges() {
        assert_eq!(array(&[0, 1, 2, 5, 7, 8]), "0-2,5,7-8");
        assert_eq!(array(&[3]), "3");
        assert_eq!(array(&[]), "");
    }

    #[test]
    fn the_script_starts_a_task() {
        let slurm = Slurm { cpus: 4, options: vec!["--partition=cpu".to_owned()] };
        let text = script(&slurm, "sweep", Path::new("/data/all"), "eigenhand sweep a.toml --out /data/all");
        assert!(text.starts_with("#!/bin/bash\n"));
        for line in ["#SBATCH --cpus-per-task=4", "#SBATCH --partition=cpu", "#SBATCH --output=/data/all/slurm-%a.log"]
        {
            assert!(text.lines().any(|l| l == line), "{text}");
        }
        assert!(text.contains("exec eigenhand sweep a.toml --out /data/all --workers"), "{text}");
    }
}
