//! No branch inside a loop, and so no loop's end, depends on nothing but uniforms.
//!
//! Quirk `uniform-bound` of `gpu/src/quirks.rs`. A comparison with anything that is no uniform, such as the length of a
//! storage array, keeps the software driver from it.

use crate::Program;
use naga::{AddressSpace, Block, Expression, Function, Handle, Module, Statement, Type, TypeInner};

/// What a value is made of, constants and local variables aside.
#[derive(Clone, Copy, Default)]
struct Origin {
    uniform: bool,
    other: bool,
}

impl Origin {
    const UNIFORM: Self = Self { uniform: true, other: false };
    const OTHER: Self = Self { uniform: false, other: true };

    fn and(self, more: Self) -> Self {
        Self { uniform: self.uniform || more.uniform, other: self.other || more.other }
    }
}

fn origin(module: &Module, function: &Function, expression: Handle<Expression>) -> Origin {
    let of = |handle: &Handle<Expression>| origin(module, function, *handle);
    match &function.expressions[expression] {
        Expression::Literal(_)
        | Expression::Constant(_)
        | Expression::Override(_)
        | Expression::ZeroValue(_)
        | Expression::LocalVariable(_) => Origin::default(),
        Expression::GlobalVariable(variable) => match module.global_variables[*variable].space {
            AddressSpace::Uniform | AddressSpace::Immediate => Origin::UNIFORM,
            _ => Origin::OTHER,
        },
        // A struct that is handed in may be a uniform if its type is one's; a number is the caller's business.
        Expression::FunctionArgument(index) => {
            let argument = function.arguments[*index as usize].ty;
            let is_uniform = module.global_variables.iter().any(|(_, variable)| {
                matches!(variable.space, AddressSpace::Uniform | AddressSpace::Immediate)
                    && contains(module, variable.ty, argument)
            });
            if is_uniform { Origin::UNIFORM } else { Origin::OTHER }
        }
        Expression::Load { pointer } => of(pointer),
        Expression::AccessIndex { base, .. } => of(base),
        Expression::Splat { value, .. } => of(value),
        Expression::Swizzle { vector, .. } => of(vector),
        Expression::Unary { expr, .. } | Expression::As { expr, .. } => of(expr),
        Expression::Relational { argument, .. } => of(argument),
        Expression::Binary { left, right, .. } => of(left).and(of(right)),
        Expression::Select { condition, accept, reject } => of(condition).and(of(accept)).and(of(reject)),
        Expression::Math { arg, arg1, arg2, arg3, .. } => {
            [Some(arg), arg1.as_ref(), arg2.as_ref(), arg3.as_ref()]
                .into_iter()
                .flatten()
                .fold(Origin::default(), |sum, argument| sum.and(of(argument)))
        }
        Expression::Compose { components, .. } => {
            components.iter().fold(Origin::default(), |sum, component| sum.and(of(component)))
        }
        _ => Origin::OTHER,
    }
}

/// Whether a type is a struct that is `part`, or holds one.
fn contains(module: &Module, whole: Handle<Type>, part: Handle<Type>) -> bool {
    let TypeInner::Struct { members, .. } = &module.types[whole].inner else { return false };
    whole == part || members.iter().any(|member| contains(module, member.ty, part))
}

/// Names of the functions that branch on uniforms alone inside a loop.
fn offenders(module: &Module) -> Vec<String> {
    let named = module.functions.iter().map(|(_, function)| function);
    let all = named.chain(module.entry_points.iter().map(|entry| &entry.function));
    all.filter(|function| offends(module, function, &function.body, false))
        .map(|function| function.name.clone().unwrap_or_default())
        .collect()
}

fn offends(module: &Module, function: &Function, block: &Block, in_loop: bool) -> bool {
    let bare = |condition| {
        let origin = origin(module, function, condition);
        origin.uniform && !origin.other
    };
    block.iter().any(|statement| match statement {
        Statement::Block(inner) => offends(module, function, inner, in_loop),
        Statement::If { condition, accept, reject } => {
            (in_loop && bare(*condition))
                || offends(module, function, accept, in_loop)
                || offends(module, function, reject, in_loop)
        }
        Statement::Loop { body, continuing, break_if } => {
            break_if.is_some_and(bare)
                || offends(module, function, body, true)
                || offends(module, function, continuing, true)
        }
        Statement::Switch { cases, .. } => {
            cases.iter().any(|case| offends(module, function, &case.body, in_loop))
        }
        _ => false,
    })
}

fn parse(source: &str) -> Module {
    naga::front::wgsl::parse_str(source).unwrap_or_else(|error| panic!("{}", error.emit_to_string(source)))
}

/// Panics if a program branches on uniforms alone inside a loop.
pub(super) fn check(programs: &[&Program]) {
    for program in programs {
        let found = offenders(&parse(program.source));
        assert!(found.is_empty(), "{}: {found:?}", program.label);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loop_bounded_by_a_uniform_is_found_and_one_bounded_by_an_array_is_not() {
        let program = |bound: &str, argument: &str| {
            format!(
                "struct Settings {{ count: u32, on: u32 }}
                 @group(0) @binding(0) var<uniform> settings: Settings;
                 @group(0) @binding(1) var<storage, read_write> sums: array<u32>;
                 fn add(k: Settings) {{ for (var i = 0u; i < {argument}; i++) {{ sums[i] += 1u; }} }}
                 @compute @workgroup_size(1)
                 fn main() {{
                     add(settings);
                     for (var i = 0u; {bound}; i++) {{ sums[0] += i; }}
                 }}"
            )
        };
        let (fine, length) =
            ("i < min(settings.count, arrayLength(&sums))", "min(k.count, arrayLength(&sums))");
        assert!(offenders(&parse(&program(fine, length))).is_empty());
        assert_eq!(offenders(&parse(&program("i < settings.count", length))), ["main"]);
        assert_eq!(offenders(&parse(&program("i < settings.count && settings.on > 0u", length))), ["main"]);
        assert_eq!(offenders(&parse(&program(fine, "k.count"))), ["add"]);
    }
}
