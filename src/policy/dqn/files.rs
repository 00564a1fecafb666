//! Tests of weights files: contents and rejected files.

use rand::RngExt;

use super::tests::{actions, trained};
use super::*;
use crate::policy::toy;
use crate::rng;

/// Reference implementation of one layer, as in PyTorch's `Linear`: y_o = sum_i W[o, i] x_i + b_o.
fn linear(file: &safetensors::SafeTensors, name: &str, x: &[f64]) -> Vec<f64> {
    let read = |part: &str| -> (Vec<usize>, Vec<f64>) {
        let tensor = file.tensor(&format!("{name}.{part}")).unwrap();
        let values = tensor.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b).into());
        (tensor.shape().to_vec(), values.collect())
    };
    let ((shape, weight), (outputs, bias)) = (read("weight"), read("bias"));
    assert_eq!((shape[1], shape[0]), (x.len(), outputs[0]), "{name}");
    let dot = |o: usize| x.iter().enumerate().map(|(i, v)| weight[o * x.len() + i] * v).sum::<f64>();
    (0..shape[0]).map(|o| dot(o) + bias[o]).collect()
}

#[test]
fn scores_follow_from_the_file_alone() {
    let (dqn, task) = (trained(), toy::task(0.27));
    let bytes = dqn.to_safetensors().unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let wide = |v: Vec<f32>| -> Vec<f64> { v.into_iter().map(f64::from).collect() };
    let relu = |v: Vec<f64>| -> Vec<f64> { v.into_iter().map(|x| x.max(0.0)).collect() };
    let (features, some) = (FeatureExtractor::new(&task), actions(&task, 20));
    for (action, score) in some.iter().zip(dqn.score(&task, &some).unwrap()) {
        let seen = relu(linear(&file, "scene", &wide(features.scene())));
        let done = relu(linear(&file, "action", &wide(features.action(action))));
        let (gamma, beta) = (linear(&file, "film_gamma", &done), linear(&file, "film_beta", &done));
        let film = (0..seen.len()).map(|i| (1.0 + gamma[i]) * seen[i] + beta[i]).collect();
        let by_hand = linear(&file, "score", &relu(linear(&file, "hidden", &relu(film))))[0];
        assert!((by_hand - f64::from(score)).abs() < 1e-4 * by_hand.abs().max(1.0), "{by_hand} {score}");
    }
}

#[test]
fn round_trips_through_bytes() {
    let (dqn, task) = (trained(), toy::task(0.7));
    let bytes = dqn.to_safetensors().unwrap();
    let loaded = Dqn::from_safetensors(&bytes).unwrap();
    assert_eq!(loaded, dqn);
    assert_eq!(loaded.to_safetensors().unwrap(), bytes);
    assert_eq!(loaded.score(&task, &actions(&task, 50)), dqn.score(&task, &actions(&task, 50)));
}

/// `bytes` with its header replaced by an edited one.
fn with_header(bytes: &[u8], edit: impl Fn(String) -> String) -> Vec<u8> {
    let n = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let header = edit(String::from_utf8(bytes[8..8 + n].to_vec()).unwrap());
    [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &bytes[8 + n..]].concat()
}

#[test]
fn rejects_incompatible_weights() {
    let bytes = trained().to_safetensors().unwrap();
    let check = |bytes: &[u8], wanted: &str| match Dqn::from_safetensors(bytes) {
        Err(Error::Input(input)) => {
            let text = input.to_string();
            assert!(text.contains(wanted), "{text}, not {wanted}");
            assert!(!input.allowed.is_empty());
        }
        other => panic!("{other:?}"),
    };
    let edited = |from: &str, to: &str| {
        with_header(&bytes, |h| {
            assert!(h.contains(from), "{from} not in {h}");
            h.replace(from, to)
        })
    };
    check(b"", "safetensors");
    check(b"not a safetensors file at all", "safetensors");
    check(&bytes[..bytes.len() - 1], "safetensors");
    check(&bytes[..100], "safetensors");
    check(&edited("\"iplw\":", "\"other\":"), "metadata.iplw");
    check(&edited("hidden.weight", "hodden.weight"), "hodden.weight");
    check(&edited("iplw.policy/2", "iplw.policy/1"), "metadata.iplw.format");
    check(&edited("iplw.policy/2", "iplw.policy/1"), "train it again");
    check(&edited(r#"\"hidden\":32"#, r#"\"hidden\":64"#), "scene.weight");
    check(&edited(r#"\"hidden\":32"#, r#"\"hidden\":99999999999"#), "hidden");
    check(&edited(r#"\"dimensions\":["#, r#"\"dimensions\":[1"#), "weight");
    check(&edited(r#"\"family\""#, r#"\"famyli\""#), "famyli");
    check(&edited("[1,32]", "[32,1]"), "score.weight");
    let mut not_finite = bytes.clone();
    let last = not_finite.len() - 4;
    not_finite[last..].copy_from_slice(&f32::NAN.to_le_bytes());
    check(&not_finite, "finite");
}

/// Loading a corrupted file gives a policy or an error, never a panic.
#[test]
fn corrupted_files_never_panic() {
    let bytes = trained().to_safetensors().unwrap();
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let mut rng = rng::stream(5, "corrupt");
    for _ in 0..2000 {
        let mut broken = bytes.clone();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..header);
            broken[at] = rng.random();
        }
        if rng.random_range(0..4) == 0 {
            broken.truncate(rng.random_range(0..bytes.len()));
        }
        match Dqn::from_safetensors(&broken) {
            Ok(_) | Err(Error::Input(_)) => {}
            Err(other) => panic!("{other:?}"),
        }
    }
}
