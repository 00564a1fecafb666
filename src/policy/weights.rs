//! Serialisation of named weight matrices as safetensors.
//!
//! Layout as PyTorch's `Linear`: `<layer>.weight` is [out, in], row-major, `<layer>.bias` is [out], both f32.
//! All metadata is one JSON string under the key `iplw`, because the order of several keys in a safetensors header is random, and the
//! same policy should give the same bytes.

use std::collections::HashMap;

use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};

use crate::error::{Error, Result};
use crate::neural::DenseLayer;

/// Metadata key.
const KEY: &str = "iplw";

/// Layers and metadata as safetensors bytes.
pub fn to_bytes(layers: &[DenseLayer], metadata: &str) -> Vec<u8> {
    let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
    for layer in layers {
        let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect();
        tensors.push((format!("{}.weight", layer.name), layer.shape.to_vec(), bytes(&layer.weight)));
        tensors.push((format!("{}.bias", layer.name), vec![layer.shape[0]], bytes(&layer.bias)));
    }
    let views = tensors.iter().map(|(name, shape, bytes)| {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytes);
        (name.as_str(), view.expect("as many bytes as the shape says: layers are built so"))
    });
    let metadata = HashMap::from([(KEY.to_string(), metadata.to_string())]);
    serialize(views, Some(metadata)).expect("finite, named tensors serialise")
}

/// Metadata of safetensors bytes, without reading the tensors.
pub fn metadata(bytes: &[u8]) -> Result<String> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| refuse("the bytes", &e.to_string()))?;
    header.metadata().as_ref().and_then(|m| m.get(KEY)).cloned().ok_or_else(|| {
        Error::input(
            format!("metadata.{KEY}"),
            "missing",
            "weights saved by iplw, or with the metadata of weights downloaded from it",
        )
    })
}

/// Layers of the given names and shapes from safetensors bytes.
pub fn from_bytes(bytes: &[u8], wanted: &[(&'static str, [usize; 2])]) -> Result<Vec<DenseLayer>> {
    let file = SafeTensors::deserialize(bytes).map_err(|e| refuse("the bytes", &e.to_string()))?;
    let expected: Vec<String> =
        wanted.iter().flat_map(|(name, _)| [format!("{name}.weight"), format!("{name}.bias")]).collect();
    let mut names = file.names();
    names.sort_unstable();
    if let Some(name) = names.iter().find(|n| !expected.iter().any(|e| e == *n)) {
        return Err(Error::input(*name, "present", format!("only the tensors {}", expected.join(", "))));
    }
    let read = |name: String, shape: &[usize]| -> Result<Vec<f32>> {
        let tensor = file.tensor(&name).map_err(|_| {
            Error::input(name.clone(), "missing", format!("the tensors {}", expected.join(", ")))
        })?;
        if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
            let value = format!("{:?} of shape {:?}", tensor.dtype(), tensor.shape());
            return Err(Error::input(name, value, format!("F32 of shape {shape:?}")));
        }
        let values: Vec<f32> =
            tensor.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        match values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(Error::input(format!("{name}[{i}]"), values[i], "finite numbers")),
            None => Ok(values),
        }
    };
    wanted
        .iter()
        .map(|&(name, shape)| {
            let weight = read(format!("{name}.weight"), &shape)?;
            Ok(DenseLayer { name, shape, weight, bias: read(format!("{name}.bias"), &shape[..1])? })
        })
        .collect()
}

fn refuse(field: &str, reason: &str) -> Error {
    Error::input("weights", format!("{field}: {reason}"), "a complete safetensors file")
}
