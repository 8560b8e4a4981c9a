"""Checks manifests of kinds that are not Kubernetes' own against models made from the schemas that their operators publish.

A model leaves out what it does not know: so what it gives back must be all that was in the file.
"""

import sys

import yaml
from cloudcoil.models.keda.v1alpha1 import ScaledObject
from cloudcoil.models.prometheus_operator.v1 import PodMonitor, PrometheusRule

MODELS = {
    ("keda.sh/v1alpha1", "ScaledObject"): ScaledObject,
    ("monitoring.coreos.com/v1", "PodMonitor"): PodMonitor,
    ("monitoring.coreos.com/v1", "PrometheusRule"): PrometheusRule,
}

for path in sys.argv[1:]:
    with open(path) as file:
        for manifest in yaml.safe_load_all(file):
            model = MODELS[manifest["apiVersion"], manifest["kind"]]
            known = model.model_validate(manifest).model_dump(mode="json", by_alias=True, exclude_unset=True)
            if known != manifest:
                sys.exit(f"{path}: {manifest} has fields that {model.__name__} has not, which knows {known}")
