//! Parameters that are read from files.

/// Structs of parameters that may all be left out in a file, each with its default beside it: the one place where that default is
/// written. The JSON schema of a file takes its defaults and descriptions from here, too.
///
/// Keys that must be there are named by `#[schemars(extend("required" = [...]))]`; their default is never seen. Unknown keys are refused
/// by the checks that follow the schema. The crate that uses this depends on `serde` and `schemars`.
#[macro_export]
macro_rules! parameters {
    ($(
        $(#[$meta:meta])*
        pub struct $name:ident {
            $($(#[$field_meta:meta])* pub $field:ident: $type:ty = $default:expr,)*
        }
    )*) => {$(
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(default)]
        #[schemars(deny_unknown_fields)]
        $(#[$meta])*
        pub struct $name {
            $($(#[$field_meta])* pub $field: $type,)*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }
    )*};
}
