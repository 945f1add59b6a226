//! Looks from files: what is read, and what is refused with which words.

mod files;
