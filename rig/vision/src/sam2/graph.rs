//! ONNX Runtime: its library, loaded while the program runs, and a graph in it.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use ort::LoadDynamicError;
use ort::environment::Environment;
use ort::session::{Session, SessionInputValue};
use ort::value::{Outlet, TensorElementType, TensorRef};

use super::array::Array;
use super::error::Sam2Error;
use super::signature::{Bound, F32, I64, Signature, Tensor};
use ground::error_chain::with_causes;

/// The runtime of this process: there can be one, and its library stays loaded.
static RUNTIME: Mutex<Option<Environment>> = Mutex::new(None);

/// A graph and what it calls its tensors.
#[derive(Debug)]
pub(super) struct Graph {
    path: PathBuf,
    session: Session,
    signature: &'static Signature,
    inputs: Bound,
    outputs: Bound,
}

/// What a graph is given.
#[derive(Debug, Clone, Copy)]
pub(super) enum Feed<'a> {
    /// Numbers.
    Numbers(&'a Array),
    /// The height and width of the masks wanted, as whole numbers or not, as the graph has it.
    Size([usize; 2]),
}

/// Where the library is: as the config says, else the environment, else wherever the system finds it.
pub(super) fn library(named: Option<&Path>, folder: &Path) -> PathBuf {
    let usual = || format!("{}onnxruntime{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    match (named, std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty())) {
        // The loader would look for a relative path beside the program.
        (Some(named), _) => std::path::absolute(folder.join(named)).unwrap_or_else(|_| named.into()),
        (None, Some(path)) => path.into(),
        (None, None) => usual().into(),
    }
}

/// The runtime, from the library at `path` unless one is loaded already.
pub(super) fn runtime(path: &Path) -> Result<Environment, Sam2Error> {
    let failed = |what: String| Sam2Error::Library { path: path.into(), what };
    let mut loaded = RUNTIME.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(runtime) = &*loaded {
        return Ok(runtime.clone());
    }
    let runtime = ort::init_from(path).map_err(|error| match error {
        LoadDynamicError::Dlopen { error, .. } => failed(with_causes(&error)),
        error => failed(error.to_string()),
    })?;
    let runtime = runtime.with_telemetry(false).build().map_err(|error| failed(error.to_string()))?;
    runtime.set_log_level(ort::logging::LogLevel::Error);
    Ok(loaded.insert(runtime).clone())
}

impl Graph {
    /// Reads the graph at `path`, to be run on so many threads; its tensors must be those of `signature`.
    pub(super) fn read(
        runtime: &Environment,
        path: &Path,
        signature: &'static Signature,
        threads: usize,
    ) -> Result<Self, Sam2Error> {
        let failed = |what: String| Sam2Error::Graph { path: path.into(), what };
        let session = Session::builder(runtime)
            .map_err(|error| failed(error.to_string()))?
            .with_intra_threads(threads)
            .map_err(|error| failed(error.to_string()))?
            .commit_from_file(path)
            .map_err(|error| failed(error.to_string()))?;
        let tensors = |outlets: &[Outlet]| outlets.iter().map(tensor).collect::<Vec<Tensor>>();
        let [inputs, outputs] = signature
            .bound(&tensors(session.inputs()), &tensors(session.outputs()))
            .map_err(|mismatch| Sam2Error::Signature { path: path.into(), mismatch })?;
        Ok(Self { path: path.into(), session, signature, inputs, outputs })
    }

    /// Whether it takes the input `key`.
    pub(super) fn takes(&self, key: &str) -> bool {
        self.inputs.iter().any(|(known, _)| *known == key)
    }

    /// Whether it gives the output `key`.
    pub(super) fn gives(&self, key: &str) -> bool {
        self.outputs.iter().any(|(known, _)| *known == key)
    }

    /// Runs it: `feeds` by the wanted tensors' usual names (those that it does not take are left out), results as `keys` order them.
    pub(super) fn run<const N: usize>(
        &mut self,
        feeds: &[(&'static str, Feed)],
        keys: [&'static str; N],
    ) -> Result<[Array; N], Sam2Error> {
        let path = &self.path;
        let failed = |error: ort::Error| Sam2Error::run(path, error);
        let mut values: Vec<(&str, SessionInputValue)> = Vec::new();
        for (key, tensor) in &self.inputs {
            let Some((_, feed)) = feeds.iter().find(|(fed, _)| fed == key) else {
                return Err(Sam2Error::run(path, format!("nothing for its input `{}`", tensor.name)));
            };
            values.push((&tensor.name, value(feed, tensor).map_err(failed)?));
        }
        let results = self.session.run(values).map_err(failed)?;
        let mut arrays: [Array; N] = std::array::from_fn(|_| Array::default());
        for (array, key) in arrays.iter_mut().zip(keys) {
            let named = self.outputs.iter().find(|(known, _)| *known == key);
            let wanted = self.signature.outputs.iter().find(|wanted| wanted.names[0] == key);
            let (Some((_, tensor)), Some(wanted)) = (named, wanted) else {
                return Err(Sam2Error::run(path, format!("it has no output `{key}`")));
            };
            let (shape, numbers) =
                results[tensor.name.as_str()].try_extract_tensor::<f32>().map_err(failed)?;
            let given = Tensor { shape: shape.to_vec(), ..tensor.clone() };
            wanted
                .check("output", &given)
                .map_err(|mismatch| Sam2Error::Signature { path: path.clone(), mismatch })?;
            let sizes: Vec<usize> = shape.iter().map(|size| *size as usize).collect();
            *array = Array::new(sizes, numbers.to_vec());
        }
        Ok(arrays)
    }
}

fn value<'a>(feed: &Feed<'a>, tensor: &Tensor) -> ort::Result<SessionInputValue<'a>> {
    use ort::value::Tensor as Owned;
    Ok(match feed {
        Feed::Numbers(array) => {
            TensorRef::from_array_view((array.shape.as_slice(), array.values.as_slice()))?.into()
        }
        Feed::Size(size) if tensor.kind == I64 => {
            Owned::from_array(([2_usize], size.map(|side| side as i64).to_vec()))?.into()
        }
        Feed::Size(size) => Owned::from_array(([2_usize], size.map(|side| side as f32).to_vec()))?.into(),
    })
}

fn tensor(outlet: &Outlet) -> Tensor {
    let kind = match outlet.dtype().tensor_type() {
        Some(TensorElementType::Float32) => F32.to_owned(),
        Some(TensorElementType::Int64) => I64.to_owned(),
        Some(other) => other.to_string(),
        None => "no tensor".to_owned(),
    };
    let shape = outlet.dtype().tensor_shape().map_or_else(Vec::new, |shape| shape.to_vec());
    Tensor { name: outlet.name().to_owned(), kind, shape }
}
