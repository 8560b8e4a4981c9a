//! Binds resources by their WGSL names.

use argus_shaders::{Access, Binding};

use crate::Gpu;

/// A resource that can be bound under a WGSL name.
pub trait Bindable {
    /// The wgpu binding.
    fn resource(&self) -> wgpu::BindingResource<'_>;
}

impl Bindable for wgpu::Buffer {
    fn resource(&self) -> wgpu::BindingResource<'_> {
        self.as_entire_binding()
    }
}

impl Bindable for wgpu::BufferBinding<'_> {
    fn resource(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Buffer(self.clone())
    }
}

impl Bindable for wgpu::TextureView {
    fn resource(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::TextureView(self)
    }
}

impl Bindable for wgpu::Sampler {
    fn resource(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Sampler(self)
    }
}

/// The bindings of a call so far, and those that its program declares.
pub(crate) struct Bound<'a> {
    label: &'a str,
    declared: &'a [Binding],
    entries: Vec<(Binding, wgpu::BindingResource<'a>)>,
}

impl<'a> Bound<'a> {
    pub(crate) fn new(label: &'a str, declared: &'a [Binding]) -> Self {
        Self { label, declared, entries: Vec::with_capacity(declared.len()) }
    }

    /// Panics for a name that the entry point does not use.
    pub(crate) fn bind(&mut self, name: &str, writes: bool, resource: wgpu::BindingResource<'a>) {
        let Some(binding) = self.declared.iter().find(|b| b.name == name) else {
            panic!("{} does not use `{name}`", self.label)
        };
        assert_eq!(writes, binding.access != Access::Read, "{}: access of `{name}`", self.label);
        self.entries.push((*binding, resource));
    }

    /// The bind groups. Panics for a declared name that is not bound.
    pub(crate) fn groups(
        &self,
        gpu: &Gpu,
        layouts: &[(u32, wgpu::BindGroupLayout)],
    ) -> Vec<(u32, wgpu::BindGroup)> {
        for declared in self.declared {
            let given = self.entries.iter().any(|(b, _)| b.name == declared.name);
            assert!(given, "{}: `{}` is not bound", self.label, declared.name);
        }
        layouts
            .iter()
            .map(|(group, layout)| {
                let entries: Vec<_> = self
                    .entries
                    .iter()
                    .filter(|(binding, _)| binding.group == *group)
                    .map(|(binding, resource)| wgpu::BindGroupEntry {
                        binding: binding.index,
                        resource: resource.clone(),
                    })
                    .collect();
                let descriptor =
                    wgpu::BindGroupDescriptor { label: Some(self.label), layout, entries: &entries };
                (*group, gpu.device.create_bind_group(&descriptor))
            })
            .collect()
    }
}
