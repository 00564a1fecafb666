use iplw::task::{Placement, family};
use iplw::world::{Engine, Latents, Rollout, effect, simulate};
fn main() {
    let name = std::env::args().nth(1).unwrap();
    let n: usize = std::env::args().nth(2).unwrap().parse().unwrap();
    let per: usize = std::env::args().nth(3).unwrap().parse().unwrap();
    let damping: f64 = std::env::args().nth(4).unwrap().parse().unwrap();
    let f = family(&name).unwrap();
    let scenes = (f.candidates)(0);
    println!("{} candidates", scenes.len());
    let rp = &f.real_physics;
    let lat = Latents::of([rp.density, rp.friction, rp.restitution]);
    let eff = if damping < 1.0 { vec![effect::damping(damping)] } else { vec![] };
    let mut shares = vec![];
    let t = std::time::Instant::now();
    let mut total = 0;
    for scene in scenes.iter().take(n) {
        scene.validate().unwrap();
        let space = scene.action.as_ref().unwrap();
        let stride = space.count() / per;
        let mut placed = vec![];
        let mut tried = 0;
        for k in 0..per {
            tried += 1;
            let idx = (k * stride + (k * 7919) % stride) % space.count();
            if let Placement::Valid(s) = space.place(scene, &space.at(idx).unwrap()) {
                placed.push(s);
            }
        }
        let r: Vec<Rollout> =
            placed.iter().map(|s| Rollout { scene: s, latents: lat, effects: &eff, stop: true }).collect();
        let out = simulate(&r, Engine::Auto).unwrap();
        total += out.len();
        let solved = out.iter().filter(|t| t.solved()).count();
        let coll: u32 = out.iter().map(|t| t.collisions).sum();
        let roll: u32 = out.iter().map(|t| t.rolling_steps).sum();
        let div = out.iter().filter(|t| t.outcome.end == iplw::trajectory::End::Diverged).count();
        println!(
            "valid {}/{} solved {} share {:.3} coll {:.2} roll {:.0} div {}",
            placed.len(),
            tried,
            solved,
            solved as f64 / placed.len() as f64,
            coll as f64 / out.len() as f64,
            roll as f64 / out.len() as f64,
            div
        );
        shares.push(solved as f64 / placed.len() as f64);
    }
    shares.sort_by(f64::total_cmp);
    println!(
        "mean {:.3} median {:.3} min {:.3} max {:.3}; {:.0} rollouts/s",
        shares.iter().sum::<f64>() / shares.len() as f64,
        shares[shares.len() / 2],
        shares[0],
        shares[shares.len() - 1],
        total as f64 / t.elapsed().as_secs_f64()
    );
}
