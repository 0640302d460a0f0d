use std::path::Path;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let mut notes = Vec::new();
    let r = eigenhand_hands::import(Path::new(&args[1]), &Default::default(), &mut notes);
    for n in &notes {
        println!("  - {n}");
    }
    match r {
        Ok(i) => {
            let out = Path::new(&args[2]);
            std::fs::create_dir_all(out).unwrap();
            i.model.write(std::fs::File::create(out.join("model.xml")).unwrap()).unwrap();
            for (n, b) in &i.assets {
                std::fs::write(out.join(n), b).unwrap();
            }
            println!("  ok {} assets", i.assets.len());
        }
        Err(e) => println!("  ERROR {e}"),
    }
}
