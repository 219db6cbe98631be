#!/usr/bin/env python3
"""Makes video-objptr/ of video/: the same graphs with the tensors' other names, and with what only some exports have: an encoder of
memories without a code of age, an attention that takes the pointers' ages, a decoder that is told the size of its answer. Own work, CC0."""
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

MORE = helper.make_tensor_value_info


def renamed(name, names):
    model = onnx.load(f"video/{name}.onnx")
    for node in model.graph.node:
        node.input[:] = [names.get(one, one) for one in node.input]
        node.output[:] = [names.get(one, one) for one in node.output]
    for tensor in [*model.graph.input, *model.graph.output]:
        tensor.name = names.get(tensor.name, tensor.name)
    return model


def without_output(graph, name):
    graph.output.remove(next(one for one in graph.output if one.name == name))


def save(model, name):
    onnx.checker.check_model(model)
    onnx.save(model, f"video-objptr/{name}.onnx")


encoder = {"image": "input", "pix_feat": "image_embeddings", "high_res_feat0": "high_res_features1",
           "high_res_feat1": "high_res_features2", "vision_feats": "current_vision_feat"}
save(renamed("image_encoder", encoder), "image_encoder_tiny")

model = renamed("image_decoder", {"pred_mask": "small"})
without_output(model.graph, "small")
model.graph.input.append(MORE("frame_size", TensorProto.INT64, [2]))
model.graph.output.append(MORE("pred_mask", TensorProto.FLOAT, [1, 1, "height", "width"]))
model.graph.initializer.append(numpy_helper.from_array(np.array([1, 1], np.int64), "one_one"))
model.graph.node.append(helper.make_node("Concat", ["one_one", "frame_size"], ["sizes"], axis=0))
model.graph.node.append(helper.make_node("Resize", ["small", "", "", "sizes"], ["pred_mask"], mode="linear"))
save(model, "image_decoder_tiny")

model = renamed("memory_encoder", {})
without_output(model.graph, "temporal_code")
model.graph.node.remove(next(node for node in model.graph.node if "temporal_code" in node.output))
save(model, "memory_encoder_tiny")

model = renamed("memory_attention", {"image_embed": "fused_feat"})
model.graph.input.append(MORE("obj_ptr_offsets", TensorProto.FLOAT, ["num_ptr"]))
place = next(i for i, node in enumerate(model.graph.node) if node.op_type == "Sum")
model.graph.node[place].input.append("ages")
model.graph.node.insert(place, helper.make_node("ReduceSum", ["obj_ptr_offsets"], ["ages"], keepdims=0))
save(model, "memory_attention_objptr")
