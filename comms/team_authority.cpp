// SPDX-License-Identifier: Apache-2.0
#include "comms/team_authority.h"

#include <openssl/asn1.h>
#include <openssl/bn.h>
#include <openssl/x509v3.h>

#include <stdexcept>

#include "comms/key_folder.h"

namespace covey {
namespace {

using std::chrono::system_clock;

constexpr int kVersion3 = 2, kListVersion2 = 1;  // as X.509 counts
constexpr int kSerialBits = 127;

struct Asn1Deleter {
  void operator()(ASN1_TIME* time) const { ASN1_TIME_free(time); }
  void operator()(BIGNUM* number) const { BN_free(number); }
  void operator()(X509_EXTENSION* extension) const { X509_EXTENSION_free(extension); }
  void operator()(X509_REVOKED* entry) const { X509_REVOKED_free(entry); }
};
using Time = std::unique_ptr<ASN1_TIME, Asn1Deleter>;
using Number = std::unique_ptr<BIGNUM, Asn1Deleter>;
using Extension = std::unique_ptr<X509_EXTENSION, Asn1Deleter>;
using Revoked = std::unique_ptr<X509_REVOKED, Asn1Deleter>;

PrivateKey make_key() {
  PrivateKey key(EVP_PKEY_Q_keygen(nullptr, nullptr, "EC", "P-256"));
  require_openssl(key != nullptr, "make a key");
  return key;
}

Time time_of(system_clock::time_point time) {
  Time out(ASN1_TIME_set(nullptr, system_clock::to_time_t(time)));
  require_openssl(out != nullptr, "write a date");
  return out;
}

void add_name_entry(X509& certificate, const char* field, const std::string& text) {
  const auto* bytes = reinterpret_cast<const unsigned char*>(text.c_str());
  require_openssl(X509_NAME_add_entry_by_txt(X509_get_subject_name(&certificate), field,
                                             MBSTRING_UTF8, bytes, -1, -1, 0) == 1,
                  "name a certificate's owner");
}

void set_random_serial(X509& certificate) {
  const Number number(BN_new());
  require_openssl(
      number != nullptr &&
          BN_rand(number.get(), kSerialBits, BN_RAND_TOP_ANY, BN_RAND_BOTTOM_ANY) == 1 &&
          BN_to_ASN1_INTEGER(number.get(), X509_get_serialNumber(&certificate)) != nullptr,
      "number a certificate");
}

void add_extension(X509& certificate, X509& issuer, int nid, const char* value) {
  X509V3_CTX context{};
  X509V3_set_ctx(&context, &issuer, &certificate, nullptr, nullptr, 0);
  const Extension extension(X509V3_EXT_conf_nid(nullptr, &context, nid, value));
  require_openssl(extension != nullptr && X509_add_ext(&certificate, extension.get(), -1) == 1,
                  "extend a certificate");
}

Certificate unsigned_certificate(const Subject& subject, const Validity& validity, EVP_PKEY& key) {
  Certificate out(X509_new());
  require_openssl(out != nullptr && X509_set_version(out.get(), kVersion3) == 1 &&
                      X509_set1_notBefore(out.get(), time_of(validity.from).get()) == 1 &&
                      X509_set1_notAfter(out.get(), time_of(validity.until).get()) == 1 &&
                      X509_set_pubkey(out.get(), &key) == 1,
                  "make a certificate");
  add_name_entry(*out, "O", subject.team);
  add_name_entry(*out, "CN", subject.name);
  set_random_serial(*out);
  return out;
}

void sign_certificate(X509& certificate, X509& issuer, EVP_PKEY& key) {
  require_openssl(X509_set_issuer_name(&certificate, X509_get_subject_name(&issuer)) == 1 &&
                      X509_sign(&certificate, &key, EVP_sha256()) > 0,
                  "sign a certificate");
}

// Its name cannot be a drone's, which knows no blanks.
Authority make_one(const Subject& subject, const Validity& validity) {
  const PrivateKey key = make_key();
  const Certificate certificate = unsigned_certificate(subject, validity, *key);
  add_extension(*certificate, *certificate, NID_basic_constraints, "critical,CA:TRUE,pathlen:0");
  add_extension(*certificate, *certificate, NID_key_usage,
                "critical,keyCertSign,cRLSign,digitalSignature");
  add_extension(*certificate, *certificate, NID_subject_key_identifier, "hash");
  sign_certificate(*certificate, *certificate, *key);
  return {to_pem(*key), to_pem(*certificate)};
}

struct OpenAuthority {
  PrivateKey key;
  Certificate certificate;
};

OpenAuthority opened(const Authority& authority) {
  OpenAuthority out{private_key_from(authority.key), certificate_from(authority.certificate)};
  if (out.key == nullptr || out.certificate == nullptr)
    throw std::runtime_error("the team's authority is damaged: no key or no certificate in PEM");
  return out;
}

std::string signed_list(X509_CRL& list, const OpenAuthority& authority,
                        system_clock::time_point now) {
  require_openssl(X509_CRL_set1_lastUpdate(&list, time_of(now).get()) == 1 &&
                      X509_CRL_sort(&list) == 1 &&
                      X509_CRL_sign(&list, authority.key.get(), EVP_sha256()) > 0,
                  "sign a revocation list");
  return to_pem(list);
}

// Fast DDS refuses a list that is missing or out of date, so that it says no end.
std::string empty_list(const Authority& identity, system_clock::time_point now) {
  const OpenAuthority authority = opened(identity);
  const RevocationList list(X509_CRL_new());
  require_openssl(list != nullptr && X509_CRL_set_version(list.get(), kListVersion2) == 1 &&
                      X509_CRL_set_issuer_name(
                          list.get(), X509_get_subject_name(authority.certificate.get())) == 1,
                  "make a revocation list");
  return signed_list(*list, authority, now);
}

std::string make_certificate(const OpenAuthority& identity, const Subject& drone,
                             const Validity& validity, EVP_PKEY& key) {
  const Certificate certificate = unsigned_certificate(drone, validity, key);
  add_extension(*certificate, *identity.certificate, NID_basic_constraints, "critical,CA:FALSE");
  add_extension(*certificate, *identity.certificate, NID_key_usage, "critical,digitalSignature");
  sign_certificate(*certificate, *identity.certificate, *identity.key);
  return to_pem(*certificate);
}

}  // namespace

TeamAuthority make_authority(const std::string& team, const DomainRange& domains,
                             const Validity& validity) {
  TeamAuthority out;
  out.team = team;
  out.domains = domains;
  out.identity = make_one({team, "identity authority"}, validity);
  out.permissions = make_one({team, "permissions authority"}, validity);
  out.revoked = empty_list(out.identity, validity.from);
  return out;
}

KeyFiles make_keys(const TeamAuthority& authority, const std::string& drone,
                   const Validity& validity) {
  const Subject subject{authority.team, drone};
  const PrivateKey key = make_key();
  const OpenAuthority permissions = opened(authority.permissions);
  const auto sign_text = [&](const std::string& text) {
    return sign(text, *permissions.certificate, *permissions.key);
  };
  KeyFiles out;
  out[kPrivateKeyFile] = to_pem(*key);
  out[kCertificateFile] = make_certificate(opened(authority.identity), subject, validity, *key);
  out[kIdentityAuthorityFile] = authority.identity.certificate;
  out[kPermissionsAuthorityFile] = authority.permissions.certificate;
  out[kRevokedFile] = authority.revoked;
  out[kGovernanceFile] = sign_text(governance_xml(authority.team, authority.domains));
  out[kPermissionsFile] = sign_text(permissions_xml(subject, authority.domains, validity));
  return out;
}

std::string revoke(const TeamAuthority& authority, const std::string& certificate_pem,
                   system_clock::time_point now) {
  const Certificate certificate = certificate_from(certificate_pem);
  const RevocationList list = revocation_list_from(authority.revoked);
  if (certificate == nullptr || list == nullptr)
    throw std::runtime_error("the team's authority is damaged: no certificate or list in PEM");
  Revoked entry(X509_REVOKED_new());
  require_openssl(entry != nullptr &&
                      X509_REVOKED_set_serialNumber(
                          entry.get(), X509_get_serialNumber(certificate.get())) == 1 &&
                      X509_REVOKED_set_revocationDate(entry.get(), time_of(now).get()) == 1 &&
                      X509_CRL_add0_revoked(list.get(), entry.get()) == 1,
                  "revoke a certificate");
  (void)entry.release();  // the list's now
  return signed_list(*list, opened(authority.identity), now);
}

}  // namespace covey
