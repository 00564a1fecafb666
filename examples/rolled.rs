fn main() {
    use iplw::task::Scene;
    use iplw::world::*;
    use std::io::BufRead;
    let engine = Engine::from_name(&std::env::args().nth(1).unwrap()).unwrap();
    let every: u32 = std::env::args().nth(2).unwrap().parse().unwrap();
    let scenes: Vec<Scene> = std::io::stdin()
        .lock()
        .lines()
        .map(|l| {
            let mut s: Scene = serde_json::from_str(&l.unwrap()).unwrap();
            s.observe_every = every;
            s
        })
        .collect();
    let r: Vec<Rollout> = scenes
        .iter()
        .map(|s| Rollout { scene: s, latents: Latents::default(), effects: &[], stop: false })
        .collect();
    for t in simulate(&r, engine).unwrap() {
        println!(
            "{}",
            serde_json::json!({"t": t.times, "x": t.bodies.iter().map(|b| &b.x).collect::<Vec<_>>(), "y": t.bodies.iter().map(|b| &b.y).collect::<Vec<_>>(), "coll": t.collisions, "roll": t.rolling_steps, "solved": t.solved(),"events": t.events})
        );
    }
}
