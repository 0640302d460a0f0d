use eigenhand_train::{config::*, *};
use std::sync::atomic::AtomicBool;
fn main() -> anyhow::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let preset = match args[0].as_str() {
        "quick" => Preset::Quick,
        "paper" => Preset::Paper,
        _ => Preset::Default,
    };
    let mut layers = Layers::new(preset)?;
    for a in &args[2..] {
        layers.add_assignment(a)?;
    }
    let config = layers.resolve()?;
    let library = eigenhand_sim::ffi::MuJoCo::load()?;
    let registry = eigenhand_hands::Registry::discover(&eigenhand_hands::SearchPath::from_environment(&[]))?;
    let hand = registry.get(&config.hand)?;
    let provenance = Provenance::collect(&hand, &library);
    let task = task_of(&config, &hand, &library)?;
    let run = RunDirectory::create(Some(std::path::Path::new(&args[1])), &config, &provenance)?;
    let trainer = Trainer::create(config, provenance, hand, task, run)?;
    let stop = AtomicBool::new(false);
    let summary = trainer.run(&stop, &mut Lines::new(std::time::Duration::from_secs(20)))?;
    println!("{}", serde_json::to_string_pretty(&summary)?);
    Ok(())
}
